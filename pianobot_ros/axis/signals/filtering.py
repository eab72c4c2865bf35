"""Smoothing and slopes on an even grid."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.signal import butter, lfilter, lfilter_zi

from pianobot_ros.gap.problem.types import Array

__all__ = ["derivative", "low_pass"]


def low_pass(y: Array, dt: float, cutoff: float) -> Array:
    """Zero-phase second-order Butterworth, forwards and backwards; y (n,).

    As `scipy.signal.filtfilt` with 50 samples of odd extension, whose time goes into designing one
    and the same filter again.
    """
    b, a, rest = _designed(round(min(0.95, 2 * cutoff * dt), 12))
    n = min(y.size - 1, 50)
    long = np.concatenate([2 * y[0] - y[n:0:-1], y, 2 * y[-1] - y[-2 : -n - 2 : -1]])
    forth = lfilter(b, a, long, zi=rest * long[0])[0]
    back = lfilter(b, a, forth[::-1], zi=rest * forth[-1])[0]
    return np.ascontiguousarray(back[::-1][n : n + y.size])


@lru_cache(maxsize=64)
def _designed(share: float) -> tuple[Array, Array, Array]:
    """Coefficients for a cut at a share of the Nyquist frequency, and the state of a constant 1."""
    b, a = butter(2, share)
    return b, a, lfilter_zi(b, a)


def derivative(y: Array, dt: float) -> Array:
    """Slope (n,) by central differences of fourth order (second at the ends), so that slow logs
    lose no amplitude.
    """
    out = np.gradient(y, dt)
    out[2:-2] = (8 * (y[3:-1] - y[1:-3]) - (y[4:] - y[:-4])) / (12 * dt)
    return np.asarray(out)
