"""Compiled recurrences of the laws that have memory. All run on samples x (n,) at increasing times t (n,) s."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

ATMOSPHERE = 101_325.0  # Pa, standard


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


NOTHING = 0.02  # N: below this a sensor is not loaded


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def under_load(t: Array, x: Array) -> Array:
    """Time (n,) s since the load x (n,) came on, 0 where there is none."""
    out = np.zeros_like(x)
    for i in range(1, x.size):
        if x[i] > NOTHING:
            out[i] = out[i - 1] + t[i] - t[i - 1]
    return out


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def _unloaded(u: float, last: float, f: float, share: float) -> float:
    """State u after the load went from ``last`` to ``f``: to 1 while it falls, to 0 while it rises, over a relative change."""
    if f <= NOTHING or last <= NOTHING:
        return 0.0
    ratio = f / last
    if ratio >= 1.0:
        return float(u * ratio ** (-1.0 / share))
    return float(1.0 - (1.0 - u) * ratio ** (1.0 / share))


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def unloading(x: Array, share: float, least: float) -> Array:
    """State u in [0, 1] of a load x (n,): 1 while it falls, 0 while it rises, over ``share`` of the load and ``least``."""
    out = np.zeros_like(x)
    u = 0.0
    for i in range(1, x.size):
        u = _unloaded(u, x[i - 1] + least, x[i] + least, share)
        out[i] = u
    return out


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def unloading_force(reading: Array, gain: float, share: float, least: float) -> Array:
    """Inverse of y = f (1 + gain * unloading(f, share, least)), sample by sample by bisection (gain above -1)."""
    out = np.zeros_like(reading)
    u, last = 0.0, 0.0
    for i in range(reading.size):
        y = reading[i]
        low, high = min(y, y / (1.0 + gain)), max(y, y / (1.0 + gain))
        for _ in range(30):
            f = 0.5 * (low + high)
            if f * (1.0 + gain * _unloaded(u, last + least, f + least, share)) > y:
                high = f
            else:
                low = f
        f = 0.5 * (low + high)
        u = _unloaded(u, last + least, f + least, share)
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
def air_lag(t: Array, x: Array, tau_fall: float, tau_rise: float, band: float, emptying: float) -> Array:
    """First-order lag behind a setpoint x (n,) Pa gauge, held between samples.

    One time constant towards lower and another towards higher values; slower by 1 + distance / ``band`` far from the aim, where a
    valve is wide open, and towards lower values by the absolute pressure to the power of ``emptying``.
    """
    out = np.empty_like(x)
    y = x[0]
    out[0] = y
    for i in range(1, x.size):
        aim = x[i - 1]
        tau = tau_rise
        if aim < y:
            tau = tau_fall * max(1.0 + y / ATMOSPHERE, 1e-3) ** -emptying
        tau *= 1.0 + abs(aim - y) / band
        y += (aim - y) * (1.0 - np.exp(-(t[i] - t[i - 1]) / tau))
        out[i] = y
    return out
