"""One long log into blocks: cycles of a periodic command, else moves between rests, else equal
windows; repeats are found.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.axis.signals.cleaning import Clean, counted
from pianobot_ros.axis.signals.log_repeats import Cuts, again, conditions, pieces, spread_over
from pianobot_ros.gap.problem.constants import FEWEST_SAMPLES
from pianobot_ros.gap.problem.errors import GapError
from pianobot_ros.gap.problem.types import Array, Block, Signal

OTHER = "joint "
"""Before the name of another joint among a block's inputs."""
SINCE = "time since the log began"
DRAWN = "drawn by neighbours"
MODEL = ("model sine", "model cosine", "model inertia")
MOST_SAMPLES = 24_000
"""Samples that one diagnosis looks at; a longer log is thinned, and that is said."""
LONGEST = 12.0
"""Seconds of a block that are looked at."""
LEAST_BLOCKS = 6
"""Blocks that are kept however long they are."""
LEAD = 0.6
"""Seconds of command and position before a block that are handed to the twin, so that delays have a
past.
"""


def blocks_of(
    cleaned: Clean, most: int = 40, samples: int = MOST_SAMPLES
) -> tuple[list[Block], str]:
    """Blocks of one log and one sentence on how it was cut; at most `most`, with `samples` in all
    of them together, spread over the whole log.
    """
    driver = cleaned.command if cleaned.command is not None else cleaned.q
    if float(np.ptp(driver)) < 1e-6 and float(np.ptp(cleaned.q)) < 1e-6:
        raise GapError(f"{cleaned.log.name}: the axis never moves; a log with motion is needed")
    cuts, how = _cycles(driver, cleaned.dt)
    if cuts:
        cuts = pieces(cuts, round(LONGEST / cleaned.dt))
    else:
        cuts, how = _moves(driver, cleaned.dt)
    if not cuts:
        cuts, how = _windows(driver, cleaned.dt)
    labels = conditions(driver, cuts, cleaned.others)
    cuts, labels, thinned = _thinned(cuts, labels, cleaned.dt, most, samples)
    how += thinned
    margin = round(0.15 / cleaned.dt)  # the smoothing filter's edges
    made, moves = [], counted(cleaned)
    for k, (i, j) in enumerate(cuts):
        i, j = max(i, margin), min(j, driver.size - margin)  # noqa: PLW2901
        if j - i >= 20:
            name, condition = (f"{cleaned.log.name}:{n}" for n in (k, labels[k]))
            made.append(_block(cleaned, moves, i, j, name, condition))
    if not made:
        raise GapError(f"{cleaned.log.name}: too short to be cut into blocks")
    return made, how


def _thinned(
    cuts: Cuts, labels: list[int], dt: float, most: int, samples: int
) -> tuple[Cuts, list[int], str]:
    """At most `most` blocks of at most `LONGEST` s, evenly spread, their conditions, and what to
    say of it.
    """
    total = sum(j - i for i, j in cuts)
    long = round(LONGEST / dt)
    kept = [(i, min(j, i + long)) for i, j in cuts]
    typical = max(1, sum(j - i for i, j in kept) // max(len(kept), 1))
    chosen = spread_over(labels, min(most, max(LEAST_BLOCKS, samples // typical)))
    kept, labels = [kept[k] for k in chosen], [labels[k] for k in chosen]
    used = sum(j - i for i, j in kept)
    if used >= 0.99 * total:
        return kept, labels, ""
    share = f"{100.0 * used / total:.2g} % of the time"
    if len(kept) == len(cuts):
        return kept, labels, f"; at most {LONGEST:g} s of each are used, {share}"
    return kept, labels, f"; thinned: {len(kept)} of them are used, {share}"


def whole(c: Clean, name: str) -> Block:
    """The whole log as one block (but for the edges of the smoothing filter)."""
    margin = round(0.15 / c.dt)
    return _block(c, counted(c), margin, c.t.size - margin, name, name)


def _block(c: Clean, moves: NDArray[np.bool_], i: int, j: int, name: str, condition: str) -> Block:
    """Samples i to j of a log; of the effort what ``moves`` (n,) counts."""
    lead = max(0, i - round(LEAD / c.dt))
    t, tl, unit = c.t[i:j], c.t[lead:j], c.log.unit
    inputs = {
        "reading": Signal(tl, c.position[lead:j], unit),
        "q": Signal(tl, c.q[lead:j], unit),
        "v": Signal(tl, c.v[lead:j], f"{unit}/s"),
        "a": Signal(tl, c.a[lead:j], f"{unit}/s²"),
    }
    for joint, y in c.others.items():
        inputs[OTHER + joint] = Signal(tl, y[lead:j], "rad")
    if c.model is not None:
        for what, y in zip(MODEL, c.model.T, strict=True):
            inputs[what] = Signal(tl, y[lead:j], "")
    if c.drawn is not None:
        inputs[DRAWN] = Signal(tl, c.drawn[lead:j], "")
    bad = np.where(c.valid[i:j], 0.0, np.nan)
    outputs = {"position": Signal(t, c.position[i:j] + bad, unit)}
    if c.command is not None:
        inputs["command"] = Signal(tl, c.command[lead:j], unit)
        inputs["error integral"] = Signal(tl, c.gathered[lead:j], f"{unit} s")

    def counting(y: Array, counts: NDArray[np.bool_], of: str) -> Signal:
        sparse = slice(i, j, c.step)
        return Signal(c.t[sparse], y[sparse] + np.where(counts[sparse], 0.0, np.nan), of)

    if c.effort is not None:
        inputs["effort"] = Signal(tl, c.effort[lead:j], c.log.effort_unit)
        told = counting(c.effort, moves, c.log.effort_unit)
        if np.isfinite(told.y).sum() >= FEWEST_SAMPLES:  # a rest tells nothing of the motion
            outputs["effort"] = told
    if c.velocity is not None:
        outputs["velocity"] = counting(c.velocity, c.valid, f"{unit}/s")
    if c.twist is not None:
        inputs["twist"] = Signal(tl, c.twist[lead:j], unit)
        outputs["twist"] = counting(c.twist, c.valid, unit)
    span = float(c.t[-1] - c.t[0])
    n = len(t)
    phases = {
        "first third": (t[0], t[n // 3]),
        "middle": (t[n // 3], t[2 * n // 3]),
        "last third": (t[2 * n // 3], t[-1]),
    }
    return Block(
        name,
        condition,
        inputs,
        outputs,
        {},
        {k: (float(a), float(b)) for k, (a, b) in phases.items()},
        {
            "session_start": float(c.t[0]),
            "session_span": span,
            "session_before": c.before,
            "start": float(t[0] - c.t[0]),
            "speed": float(np.max(np.abs(c.v[i:j]))),
            "travel": float(np.ptp(c.q[i:j])),
            "cutoff": c.cutoff,
            "command_middle": c.middle,
            "lead": float(i - lead),
        },
        units={"start": "s", "speed": f"{c.log.unit}/s", "travel": c.log.unit},
    )


def repetition(x: Array, dt: float) -> tuple[int, int, float] | None:
    """First and last sample of the motion of a periodic signal, and its period in samples: the lag
    at which it repeats itself (almost) exactly; None if it does not.
    """
    moving = np.flatnonzero(np.abs(np.gradient(x)) > 0.01 * np.max(np.abs(np.gradient(x))))
    if moving.size < 20:
        return None
    first, last = int(moving[0]), int(moving[-1]) + 1
    y = x[first:last]
    n = y.size
    spread = float(np.std(y))
    centred = y - y.mean()
    least = max(round(0.25 / dt), 10)
    size = 1 << (2 * n).bit_length()
    spectrum = np.fft.rfft(centred, size)
    auto = np.fft.irfft(np.abs(spectrum) ** 2, size)[:n]
    energy = np.cumsum(centred**2)
    lags = np.arange(least, n // 2 + 1)
    if lags.size < 3 or spread == 0:
        return None
    left, right = energy[n - 1 - lags], energy[-1] - energy[lags - 1]
    corr = auto[lags] / np.sqrt(np.maximum(left * right, 1e-30))
    peaks = [
        k
        for k in range(1, lags.size - 1)
        if corr[k] >= corr[k - 1] and corr[k] >= corr[k + 1] and corr[k] > 0.95
    ]
    for k in peaks:
        lag = int(lags[k])
        if (
            float(np.quantile(np.abs(y[lag:] - y[:-lag]), 0.8)) < 0.02 * spread
        ):  # all but a start or a stop
            return first, last, _period(y, lag)
    return None


def _cycles(x: Array, dt: float) -> tuple[list[tuple[int, int]], str]:
    """Cycles of a periodic signal, several of short ones together."""
    found = repetition(x, dt)
    if found is None:
        return [], ""
    first, last, period = found
    count = int((last - first) / period + 0.02)  # the last one ends in a rest
    group = max(1, math.ceil(1.0 / (period * dt)))
    if count // group < 2:
        group = 1
    edges = [first + round(m * group * period) for m in range(count // group + 1)]
    cuts = [(a, min(b, last)) for a, b in pairwise(edges)]
    return cuts, f"{len(cuts)} repeats of a periodic command (period {period * dt:.2f} s)"


def _period(y: Array, lag: int) -> float:
    """Period in samples, to a fraction of one: the shift by many periods at which the signal
    matches itself best.
    """
    many = max(1, y.size // lag - 1)
    best, error = lag * many, math.inf
    for shift in range(max(1, lag * many - many), min(y.size - lag // 2, lag * many + many) + 1):
        misfit = float(np.mean(np.abs(y[shift:] - y[:-shift])))
        if misfit < error:
            best, error = shift, misfit
    return best / many


def stretches(flags: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Where each stretch of set flags begins, and the sample behind its last one (m, 2)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return edges.reshape(-1, 2)


def _moves(x: Array, dt: float) -> tuple[list[tuple[int, int]], str]:
    """Moves between rests of at least 0.3 s, cut in the middle of the rests, with what moves before
    the first and after the last of them.
    """
    speed = np.abs(np.gradient(x, dt))
    rest = speed < 0.01 * np.quantile(speed, 0.99)
    rests = [(a, b) for a, b in stretches(rest) if (b - a) * dt >= 0.3]
    if len(rests) < 4:
        return [], ""
    middles = [a + min((b - a) // 2, round(0.5 / dt)) for a, b in rests]
    middles = [
        *([0] if rests[0][0] > 0 else []),
        *middles,
        *([x.size] if rests[-1][1] < x.size else []),
    ]
    cuts = [(int(a), int(b)) for a, b in pairwise(middles) if (b - a) * dt >= 0.3]
    return (cuts, f"{len(cuts)} moves between rests") if len(cuts) >= 4 else ([], "")


def _windows(x: Array, dt: float) -> tuple[Cuts, str]:
    n = x.size
    count = int(np.clip(n * dt / 2.0, 4, max(24, math.ceil(n * dt / LONGEST))))
    if found := again(x, dt, n // count):
        return found, f"{len(found)} windows, some of which repeat each other"
    edges = np.linspace(0, n, count + 1).astype(int).tolist()
    return list(pairwise(edges)), f"{count} equal windows (nothing repeats)"
