"""Smoothing and slopes on an even grid."""

from __future__ import annotations

import numpy as np
from scipy.signal import butter, filtfilt

from pianobot_ros.gap.problem.types import Array

__all__ = ["derivative", "low_pass"]


def low_pass(y: Array, dt: float, cutoff: float) -> Array:
    """Zero-phase second-order Butterworth, forwards and backwards; y (n,)."""
    b, a = butter(2, min(0.95, 2 * cutoff * dt))
    return np.asarray(filtfilt(b, a, y, padlen=min(y.size - 1, 50)))


def derivative(y: Array, dt: float) -> Array:
    """Slope (n,) by central differences of fourth order (second at the ends), so that slow logs
    lose no amplitude.
    """
    out = np.gradient(y, dt)
    out[2:-2] = (8 * (y[3:-1] - y[1:-3]) - (y[4:] - y[:-4])) / (12 * dt)
    return np.asarray(out)
