"""A disturbance on its own clock (a neighbour's machine, the mains): steady in session time, so it differs between repeats.

It would count as scatter and hide in the floor. A sinusoid that is fitted to every other block and predicts the blocks between
is no scatter, and is taken out of the floor; what it leaves in the gap is then described as a function of session time.
"""

from __future__ import annotations

import numpy as np

from pianobot_ros.gap.types import Array

LEAST = 0.6
"""Share of the scatter that the line must predict in blocks it was not fitted to."""


def steady_line(t: list[Array], x: list[Array]) -> list[Array] | None:
    """Sinusoid in `t` (per block, s) that predicts the scatter `x` (per block) of other blocks; None if there is none."""
    if len(t) < 4 or any(b.size < 8 for b in t):
        return None
    order = np.argsort([b[0] for b in t])
    even, odd = order[::2], order[1::2]
    times, values = (np.concatenate([y[i] for i in even]) for y in (t, x))
    hertz = _peak(times, values)
    if hertz is None:
        return None
    coefficients = np.linalg.lstsq(_waves(times, hertz), values, rcond=None)[0]
    predicted = [x[i] - _waves(t[i], hertz) @ coefficients for i in odd]
    total = float(sum(np.sum(x[i] ** 2) for i in odd))
    if total <= 0 or 1.0 - float(sum(np.sum(r**2) for r in predicted)) / total < LEAST:
        return None
    coefficients = np.linalg.lstsq(_waves(np.concatenate(t), hertz), np.concatenate(x), rcond=None)[0]
    return [np.asarray(_waves(b, hertz) @ coefficients) for b in t]


def _waves(t: Array, hertz: float) -> Array:
    phase = 2.0 * np.pi * hertz * t
    return np.asarray(np.array([np.cos(phase), np.sin(phase)]).T)


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
