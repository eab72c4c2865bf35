"""Readings that are far off for a sample or two, as a bus or a converter makes them. A robot's own
are not: a joint moves on, and what a contact does it does again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.gap.problem.constants import FAR, MOST, NEGLIGIBLE, OF_MEDIAN, STRAY, TINY
from pianobot_ros.gap.problem.types import Array, Block, Signal, usable

__all__ = ["bridged", "median_of_five", "spiked", "spikes"]


def median_of_five(x: Array) -> Array:
    """Running median (n,) of each value, the two before it and the two behind it."""
    index = np.arange(x.size)
    about = [x[np.clip(index + k, 0, x.size - 1)] for k in (-2, -1, 0, 1, 2)]
    return np.asarray(np.median(np.array(about), 0))


def spikes(x: Array) -> NDArray[np.bool_]:
    """Which readings (n,), all of them numbers, are off those about them by half of the range of
    all, or leave them and come back by steps far beyond nearly all steps: none where that is true
    of many. A contact may do so, and stays within the range.
    """
    if x.size < 3:
        return np.zeros(x.size, bool)
    off = np.abs(x - median_of_five(x))
    low, high = _range(x)
    usual = OF_MEDIAN * float(np.median(off))
    found = off > max(MOST * (high - low), STRAY * usual, TINY)
    step = np.diff(x)
    least = FAR * max(float(np.quantile(np.abs(step), 1.0 - NEGLIGIBLE)), STRAY * usual, TINY)
    back = (np.minimum(np.abs(step[:-1]), np.abs(step[1:])) > least) & (step[:-1] * step[1:] < 0.0)
    found[1:-1] |= back
    return found if found.sum() <= 2.0 * NEGLIGIBLE * x.size else np.zeros(x.size, bool)


def _range(x: Array) -> tuple[float, float]:
    """Of all readings (n,) but those few that may be spikes."""
    low, high = np.quantile(x, [2.0 * NEGLIGIBLE, 1.0 - 2.0 * NEGLIGIBLE]).tolist()
    return low, high


def _outside(x: Array) -> NDArray[np.bool_]:
    """Which readings (n,) leave the range of the others by half of it."""
    if not x.size:
        return np.zeros(0, bool)
    low, high = _range(x)
    return (x < low - MOST * (high - low)) | (x > high + MOST * (high - low))


def spiked(blocks: Sequence[Block], name: str) -> dict[int, NDArray[np.intp]]:
    """The spikes of an output that leave the range of all others: samples of its signal, by the
    index of the block. What most repeats have at the same time is no spike.
    """
    own, times = {}, {}
    for k, block in enumerate(blocks):
        if name not in block.outputs:
            continue
        s = block.outputs[name]
        known = usable(s)
        t, y = s.t[known], s.y[known]
        found = spikes(y) & _outside(y)
        own[k] = known[found]
        times[k] = (
            t[found] - np.min(t, initial=np.inf),
            2.0 * np.median(np.diff(t)) if t.size > 1 else 0.0,
        )
    out = {}
    for k, at in own.items():
        alike = [j for j in own if j != k and blocks[j].condition == blocks[k].condition]
        own_times, near = times[k]
        again = [
            np.mean([np.any(np.abs(times[j][0] - t) <= near) for j in alike]) if alike else 0.0
            for t in own_times
        ]
        alone = at[np.array(again) < MOST]
        if alone.size:
            out[k] = alone
    return out


def bridged(signal: Signal, at: NDArray[np.intp]) -> Signal:
    """The signal with the median of those about them in the place of some samples: a simulation
    that is fed with it has a number there.
    """
    known = usable(signal)
    near = np.full(signal.y.size, np.nan)
    near[known] = median_of_five(signal.y[known])
    y = signal.y.copy()
    y[at] = near[at]
    return replace(signal, y=y)
