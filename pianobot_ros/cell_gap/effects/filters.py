"""Compiled recurrences of the laws that have memory. All run on samples x (n,) at increasing times t (n,) s."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def lag(t: Array, x: Array, tau: float) -> Array:
    """First-order lag, exact for an input that is linear between samples."""
    out = np.empty_like(x)
    y = x[0]
    out[0] = y
    for i in range(1, x.size):
        dt = t[i] - t[i - 1]
        slope = (x[i] - x[i - 1]) / dt if dt > 0 else 0.0
        decay = np.exp(-dt / tau)
        y = x[i] - slope * tau + (y - x[i - 1] + slope * tau) * decay
        out[i] = y
    return out


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def leaky_force(t: Array, reading: Array, share: float, tau: float) -> Array:
    """Inverse of y = f + share * lag(f, tau), causal."""
    out = np.empty_like(reading)
    z = 0.0
    out[0] = reading[0]
    for i in range(1, reading.size):
        gain = 1.0 - np.exp(-(t[i] - t[i - 1]) / tau)
        f = (reading[i] - share * z * (1.0 - gain)) / (1.0 + share * gain)
        z += (f - z) * gain
        out[i] = f
    return out


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def unloading(x: Array, scale: float) -> Array:
    """State u in [0, 1] that goes to 1 while x falls and back to 0 while it rises, over ``scale`` units of x."""
    out = np.zeros_like(x)
    u = 0.0
    for i in range(1, x.size):
        d = x[i] - x[i - 1]
        u = u * np.exp(-d / scale) if d > 0 else 1.0 - (1.0 - u) * np.exp(d / scale)
        out[i] = u
    return out


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def unloading_force(reading: Array, share: float, scale: float) -> Array:
    """Inverse of y = f (1 + share * unloading(f, scale)), by the previous state."""
    out = np.zeros_like(reading)
    u, last = 0.0, 0.0
    for i in range(reading.size):
        f = reading[i] / (1.0 + share * u)
        d = f - last
        u = u * np.exp(-d / scale) if d > 0 else 1.0 - (1.0 - u) * np.exp(d / scale)
        f = reading[i] / (1.0 + share * u)
        last = f
        out[i] = f
    return out


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def play(x: Array, width: float) -> Array:
    """Play operator of full ``width`` (Krasnosel'skii and Pokrovskii 1989), starting in the middle of the gap."""
    out = np.empty_like(x)
    y = x[0]
    half = 0.5 * width
    for i in range(x.size):
        y = max(x[i] - half, min(x[i] + half, y))
        out[i] = y
    return out


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def rate_lag(t: Array, x: Array, tau_fall: float, tau_rise: float) -> Array:
    """First-order lag with one time constant towards lower and another towards higher values."""
    out = np.empty_like(x)
    y = x[0]
    out[0] = y
    for i in range(1, x.size):
        tau = tau_fall if x[i] < y else tau_rise
        y += (x[i] - y) * (1.0 - np.exp(-(t[i] - t[i - 1]) / tau))
        out[i] = y
    return out
