"""A disturbance on its own clock (a neighbour's machine, the mains): steady in session time, so it
differs between repeats.

It would count as scatter and hide in the floor. A sinusoid that keeps its phase from block to block
is no scatter, and is taken out of the floor; what it leaves in the gap is then described as a
function of session time.
A loop that answers such a disturbance may look like one with another delay or inertia: one line
that stands in a residual, and not in what the twin predicts there, tells that it is none.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize_scalar

from pianobot_ros.gap.problem.constants import CHANCE, LEADERS, MOST, NEGLIGIBLE, TINY
from pianobot_ros.gap.problem.problem import Problem
from pianobot_ros.gap.problem.types import Array

Rows = list[tuple[Array, Array]]
"""Times (n,), s, and values (n,) of one block after the other."""


def rows_of(problem: Problem, o: int, flat: Array) -> Rows:
    """What flat values (size,) are where an observable is judged."""
    cells = problem.cells_of(o)
    return [(c.t[problem.mask[c.start : c.stop]], problem.judged(c, flat)) for c in cells]


def steady_lines(groups: list[Rows], share: float) -> list[list[Array]] | None:
    """Sinusoids in session time that the scatter of repeats has, for each of the `groups` of
    repeats by block; None where there are none. Together they must be `share` of the scatter.

    What is slower than a block is a level of it, and not looked for.
    """
    if not groups or any(t.size < 8 for group in groups for t, _ in group):
        return None
    scatter, lines = _Scatter(groups), list[float]()
    while len(lines) < LEADERS and (line := scatter.strongest(lines)) is not None:
        lines.append(line)
    if not lines or scatter.explained(lines) < share:
        return None
    fit = scatter.fit(lines)
    return [[np.asarray(waves(t, lines) @ fit) for t, _ in group] for group in groups]


class _Scatter:
    """What repeats differ by from their mean, in groups; of lines, too, only that is seen of
    them.
    """

    def __init__(self, groups: list[Rows]) -> None:
        self.times = [np.array([t for t, _ in group]) for group in groups]
        self.values = [_centred(_level(np.array([x for _, x in group]))) for group in groups]
        self.flat = np.concatenate([x.ravel() for x in self.values])
        self.stamps = np.concatenate([t.ravel() for t in self.times])
        self.slowest = 2.0 / max(min(float(np.ptp(t, axis=1).min()) for t in self.times), TINY)

    def columns(self, lines: list[float]) -> Array:
        """What is seen of unit waves of each line (samples, 2 lines)."""
        return np.concatenate(
            [_centred(waves(t, lines)).reshape(-1, 2 * len(lines)) for t in self.times]
        )

    def fit(self, lines: list[float]) -> Array:
        """Least-squares amplitudes of these lines together (2 lines,)."""
        columns = self.columns(lines)
        return np.asarray(
            np.linalg.pinv(columns.T @ columns, hermitian=True) @ columns.T @ self.flat
        )

    def explained(self, lines: list[float]) -> float:
        """Share of the scatter that these lines are."""
        columns = self.columns(lines)
        along = columns.T @ self.flat
        own = along @ np.linalg.pinv(columns.T @ columns, hermitian=True) @ along
        return float(own) / max(float(self.flat @ self.flat), TINY)

    def left(self, lines: list[float]) -> list[Array]:
        """The values without these lines, by group (repeats, n)."""
        if not lines:
            return self.values
        fit = self.fit(lines)
        return [
            x - _centred(waves(t, lines) @ fit)
            for t, x in zip(self.times, self.values, strict=True)
        ]

    def strongest(self, lines: list[float]) -> float | None:
        """Frequency (Hz) of the strongest line beside these, if it keeps its phase from block to
        block by more than chance: where it fits best, since that only differences from a mean are
        seen moves the peak of the spectrum.
        """
        left = self.left(lines)
        about = peak(self.stamps, np.concatenate([x.ravel() for x in left]), self.slowest)
        if about is None:
            return None
        width = 1.0 / float(np.ptp(self.stamps))
        hertz = sharpened(lambda hertz: self.explained([*lines, hertz]), about, width)
        return hertz if self._chance(left, hertz) <= CHANCE else None

    def _chance(self, left: list[Array], hertz: float) -> float:
        """Probability that a line in what is left (repeats, n) seems to keep its phase."""
        pairs = []
        for t, x in zip(self.times, left, strict=True):
            turned = np.exp(2j * np.pi * hertz * t[:, 0])
            local = np.exp(-2j * np.pi * hertz * (t - t[:, :1]))
            pairs.append((np.sum(x * local, axis=1), _centred(turned)))
        amplitudes, turns = (np.concatenate(part) for part in zip(*pairs, strict=True))
        freedom = sum(len(t) - 1 for t in self.times)
        return _chance(amplitudes, turns, freedom, self.stamps)


def own_clock(rows: Rows, prediction: Rows) -> float | None:
    """Frequency (Hz) of a line that makes up most of the residual in `rows` and that the
    `prediction` has less of, else None.
    """
    if not rows:
        return None
    t, x = (np.concatenate(part) for part in zip(*rows, strict=True))
    hertz = peak(t, x)
    if hertz is None or len(rows) < 2 or line_share(rows, hertz) < MOST:
        return None
    amplitudes = np.array([np.sum(x * np.exp(-2j * np.pi * hertz * t)) for t, x in rows])
    sizes = np.array([float(t.size) for t, _ in rows])
    if _chance(amplitudes, sizes, len(rows), t) > CHANCE:
        return None
    residual, predicted = (
        float(np.linalg.norm(line_of([(t, x - x.mean()) for t, x in each], hertz)))
        for each in (rows, prediction)
    )
    return hertz if predicted < residual else None


def line_share(rows: Rows, hertz: float) -> float:
    """Share of the values that a line of this frequency, fitted to every other block, predicts in
    the blocks between.
    """
    coefficients = line_of(rows[::2], hertz)
    t, x = (np.concatenate(part) for part in zip(*rows[1::2], strict=True))
    total = float(np.sum(x**2))
    left = float(np.sum((x - waves(t, [hertz]) @ coefficients) ** 2))
    return 1.0 - left / total if total > 0 else 0.0


def _chance(amplitudes: Array, turns: Array, freedom: int, t: Array) -> float:
    """Probability that complex amplitudes of blocks (n,), of which `freedom` are independent, agree
    so well with `turns` (n,) at some frequency of a session with stamps `t`, s: of independent
    Gaussian ones the share along any direction has a beta distribution (Fisher 1929, Proceedings of
    the Royal Society A 125), and so many frequencies are looked at as the session tells apart.
    """
    along = abs(np.vdot(turns, amplitudes)) ** 2
    whole = float(np.sum(np.abs(amplitudes) ** 2) * np.sum(np.abs(turns) ** 2))
    looked = max(float(np.ptp(t)) * 0.5 / _interval(t), 1.0)
    return float(looked * max(1.0 - along / max(whole, TINY), 0.0) ** max(freedom - 1, 0))


def _centred(rows: Array) -> Array:
    """Rows (repeats, ...) less their mean."""
    return np.asarray(rows - rows.mean(0))


def _level(rows: Array) -> Array:
    """Rows (repeats, n) less each one's own level."""
    return np.asarray(rows - rows.mean(1, keepdims=True))


def line_of(rows: Rows, hertz: float) -> Array:
    """Cosine and sine amplitude (2,) of a line in all rows together."""
    t, x = (np.concatenate(part) for part in zip(*rows, strict=True))
    return np.asarray(np.linalg.lstsq(waves(t, [hertz]), x, rcond=None)[0])


def waves(t: Array, hertz: list[float]) -> Array:
    """Cosines and sines of each line at `t` (..., 2 lines)."""
    phase = 2.0 * np.pi * np.multiply.outer(t, hertz)
    return np.concatenate([np.cos(phase), np.sin(phase)], axis=-1)


def peak(t: Array, x: Array, least: float = 0.0) -> float | None:
    """Frequency (Hz) of the strongest line from `least` on, between four periods in the session and
    half the sampling rate.
    """
    dt, span = _interval(t), float(np.ptp(t))
    if dt <= 0 or span < 40 * dt:
        return None
    dt = max(dt, span / 2**17)
    index = np.floor((t - t.min()) / dt).astype(int)
    grid = np.bincount(index, x)
    power = np.abs(np.fft.rfft(grid, 8 * grid.size)) ** 2
    hertz = np.fft.rfftfreq(8 * grid.size, dt)
    allowed = (hertz > max(4.0 / span, least)) & (hertz < 0.4 / dt)
    return float(hertz[allowed][np.argmax(power[allowed])]) if allowed.any() else None


def sharpened(explained: Callable[[float], float], about: float, width: float) -> float:
    """The frequency (Hz) within a `width` of a peak at which most is `explained`."""
    found = minimize_scalar(
        lambda hertz: -explained(float(hertz)),
        bounds=(about - width, about + width),
        method="bounded",
        options={"xatol": NEGLIGIBLE * width},
    )
    return float(found.x)


def _interval(t: Array) -> float:
    """Usual interval of samples, s; 0 where there is none."""
    steps = np.diff(np.sort(t))
    return float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0
