"""A disturbance on its own clock (a neighbour's machine, the mains): steady in session time, so it differs between repeats.

It would count as scatter and hide in the floor. Sinusoids that are fitted to every other block and predict the blocks between
are no scatter, and are taken out of the floor; what they leave in the gap is then described as a function of session time.
"""

from __future__ import annotations

import numpy as np

from pianobot_ros.gap.types import Array

LEAST, MORE = 1.6, 0.05
"""Share of the scatter that the first line (over the root of the number of blocks) and each further one must predict in blocks it
was not fitted to."""
SLOW = 0.6
"""Likewise of a line with less than three periods in a block: a few blocks' levels easily follow one by chance."""
LINES = 4


def steady_line(t: list[Array], x: list[Array]) -> list[Array] | None:
    """Sinusoids in `t` (per block, s) that predict the scatter `x` (per block) of other blocks; None if there are none."""
    if len(t) < 4 or any(b.size < 8 for b in t):
        return None
    order = np.argsort([b[0] for b in t])
    even, odd = order[::2], order[1::2]
    times, values = (np.concatenate([y[i] for i in even]) for y in (t, x))
    later, unseen = (np.concatenate([y[i] for i in odd]) for y in (t, x))
    total = float(np.sum(unseen**2))
    if total <= 0:
        return None
    span = float(np.median([np.ptp(b) for b in t]))
    least = min(LEAST / np.sqrt(len(t)), SLOW)
    lines: list[float] = []
    open_share, rest = 1.0, values
    while len(lines) < LINES:
        hertz = _peak(times, rest)
        if hertz is None:
            break
        trial = [*lines, hertz]
        coefficients = np.linalg.lstsq(_waves(times, trial), values, rcond=None)[0]
        share = float(np.sum((unseen - _waves(later, trial) @ coefficients) ** 2)) / total
        if open_share - share < (SLOW if hertz * span < 3.0 else MORE if lines else least):
            break
        lines, open_share, rest = trial, share, values - _waves(times, trial) @ coefficients
    if not lines:
        return None
    coefficients = np.linalg.lstsq(_waves(np.concatenate(t), lines), np.concatenate(x), rcond=None)[0]
    return [np.asarray(_waves(b, lines) @ coefficients) for b in t]


def _waves(t: Array, hertz: list[float]) -> Array:
    phase = 2.0 * np.pi * np.outer(t, hertz)
    return np.hstack([np.cos(phase), np.sin(phase)])


def _peak(t: Array, x: Array) -> float | None:
    """Frequency (Hz) of the strongest line, between four periods in the session and half the sampling rate."""
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
