"""A disturbance on its own clock (a neighbour's machine, the mains): steady in session time, so it
differs between repeats.

It would count as scatter and hide in the floor. Sinusoids that are fitted to every other block and
predict the blocks between are no scatter, and are taken out of the floor; what they leave in the
gap is then described as a function of session time.
A loop that answers such a disturbance may look like one with another delay or inertia: one line
that stands in a residual, and not in what the twin predicts there, tells that it is none.
"""

from __future__ import annotations

import numpy as np

from pianobot_ros.gap.problem.constants import LINE_SHARE, LINES, MORE_LINE, OWN_LINE, SLOW_LINE
from pianobot_ros.gap.problem.types import Array


def steady_line(t: list[Array], x: list[Array]) -> list[Array] | None:
    """Sinusoids in `t` (per block, s) that predict the scatter `x` (per block) of other blocks;
    None if there are none.
    """
    if len(t) < 4 or any(b.size < 8 for b in t):
        return None
    times, values, later, unseen = _halves(t, x)
    total = float(np.sum(unseen**2))
    if total <= 0:
        return None
    span = float(np.median([np.ptp(b) for b in t]))
    least = min(LINE_SHARE / np.sqrt(len(t)), SLOW_LINE)
    lines: list[float] = []
    open_share, rest = 1.0, values
    while len(lines) < LINES:
        hertz = peak(times, rest)
        if hertz is None:
            break
        trial = [*lines, hertz]
        coefficients = np.linalg.lstsq(_waves(times, trial), values, rcond=None)[0]
        share = float(np.sum((unseen - _waves(later, trial) @ coefficients) ** 2)) / total
        if open_share - share < (
            SLOW_LINE if hertz * span < 3.0 else MORE_LINE if lines else least
        ):
            break
        lines, open_share, rest = trial, share, values - _waves(times, trial) @ coefficients
    if not lines:
        return None
    coefficients = np.linalg.lstsq(_waves(np.concatenate(t), lines), np.concatenate(x), rcond=None)[
        0
    ]
    return [np.asarray(_waves(b, lines) @ coefficients) for b in t]


def own_clock(t: list[Array], residual: list[Array], prediction: list[Array]) -> float | None:
    """Frequency (Hz) of a line that makes up most of `residual` (per block) and that `prediction`
    has less of, else None.
    """
    if len(t) < 4:
        return None
    times, values, _, _ = _halves(t, residual)
    hertz = peak(times, values)
    if hertz is None or line_share(t, residual, hertz) < OWN_LINE:
        return None
    amplitude = [float(np.linalg.norm(_line(t, x, hertz))) for x in (residual, prediction)]
    return hertz if amplitude[1] < amplitude[0] else None


def line_share(t: list[Array], x: list[Array], hertz: float) -> float:
    """Share of `x` (per block) that a line of this frequency, fitted to every other block, predicts
    in the blocks between.
    """
    times, values, later, unseen = _halves(t, x)
    coefficients = np.linalg.lstsq(_waves(times, [hertz]), values, rcond=None)[0]
    total = float(np.sum(unseen**2))
    return (
        1.0 - float(np.sum((unseen - _waves(later, [hertz]) @ coefficients) ** 2)) / total
        if total > 0
        else 0.0
    )


def _line(t: list[Array], x: list[Array], hertz: float) -> Array:
    """Cosine and sine amplitude (2,) of a line beside the level of each block."""
    level = np.concatenate([b - b.mean() for b in x])
    return np.asarray(np.linalg.lstsq(_waves(np.concatenate(t), [hertz]), level, rcond=None)[0])


def _halves(t: list[Array], x: list[Array]) -> tuple[Array, Array, Array, Array]:
    """Times and values of every other block, and of the blocks between."""
    order = np.argsort([b[0] for b in t])
    first, second = (
        [np.concatenate([y[i] for i in half]) for y in (t, x)] for half in (order[::2], order[1::2])
    )
    return first[0], first[1], second[0], second[1]


def _waves(t: Array, hertz: list[float]) -> Array:
    phase = 2.0 * np.pi * np.outer(t, hertz)
    return np.hstack([np.cos(phase), np.sin(phase)])


def peak(t: Array, x: Array) -> float | None:
    """Frequency (Hz) of the strongest line, between four periods in the session and half the
    sampling rate.
    """
    steps = np.diff(np.sort(t))
    dt = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0
    span = float(np.ptp(t))
    if dt <= 0 or span < 40 * dt:
        return None
    dt = max(dt, span / 2**17)
    index = np.floor((t - t.min()) / dt).astype(int)
    grid = np.bincount(index, x)
    power = np.abs(np.fft.rfft(grid, 8 * grid.size)) ** 2
    hertz = np.fft.rfftfreq(8 * grid.size, dt)
    allowed = (hertz > 4.0 / span) & (hertz < 0.4 / dt)
    return float(hertz[allowed][np.argmax(power[allowed])]) if allowed.any() else None
