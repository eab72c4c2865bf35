"""Compiled recurrences of the laws that have memory. All run on samples x (n,) at increasing times
t (n,) s.

``state`` (STATE,) is what they remember: all 0 before the first sample. A signal that comes in
pieces, with one state, gives the same as the whole signal at once.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pianobot_ros.cell.arrays import Array

ATMOSPHERE = 101_325.0  # Pa, standard
STATE = 4
BEGUN, LEVEL, LAST, TIME = range(
    STATE
)  # whether there was a sample; output, input, time of the last


EXACT = 1e-9
"""Share of a reading to which its force is found."""


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def _begin(state: Array, t: float, x: float, y: float) -> None:
    """The first sample: nothing was before it."""
    if state[BEGUN] == 0.0:
        state[BEGUN], state[LEVEL], state[LAST], state[TIME] = 1.0, y, x, t


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def lag(t: Array, x: Array, tau: float, state: Array) -> Array:
    """First-order lag, exact for an input that is linear between samples."""
    out = np.empty_like(x)
    _begin(state, t[0], x[0], x[0])
    for i in range(x.size):
        dt = t[i] - state[TIME]
        slope = (x[i] - state[LAST]) / dt if dt > 0 else 0.0
        decay = np.exp(-dt / tau)
        y = x[i] - slope * tau + (state[LEVEL] - state[LAST] + slope * tau) * decay
        out[i] = y
        state[LEVEL], state[LAST], state[TIME] = y, x[i], t[i]
    return out


NOTHING = 0.02  # N: below this a sensor is not loaded


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def under_load(t: Array, x: Array, state: Array) -> Array:
    """Time (n,) s since the load x (n,) came on, 0 where there is none."""
    out = np.zeros_like(x)
    _begin(state, t[0], x[0], 0.0)
    for i in range(x.size):
        state[LEVEL] = state[LEVEL] + t[i] - state[TIME] if x[i] > NOTHING else 0.0
        out[i] = state[LEVEL]
        state[TIME] = t[i]
    return out


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def since_change(t: Array, x: Array, least: float, state: Array) -> Array:
    """Time (n,) s since x (n,) last changed by more than ``least`` from one sample to the next; at
    first since the first sample.
    """
    out = np.empty_like(x)
    _begin(state, t[0], x[0], t[0])
    for i in range(x.size):
        if abs(x[i] - state[LAST]) > least:
            state[LEVEL] = t[i]
        state[LAST] = x[i]
        out[i] = t[i] - state[LEVEL]
    return out


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def _unloaded(u: float, last: float, f: float, share: float) -> float:
    """State u after the load went from ``last`` to ``f``: to 1 while it falls, to 0 while it rises,
    over a relative change.
    """
    if f <= NOTHING or last <= NOTHING:
        return 0.0
    ratio = f / last
    if ratio >= 1.0:
        return float(u * ratio ** (-1.0 / share))
    return float(1.0 - (1.0 - u) * ratio ** (1.0 / share))


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def unloading(x: Array, share: float, least: float, state: Array) -> Array:
    """State u in [0, 1] of a load x (n,): 1 while it falls, 0 while it rises, over ``share`` of the
    load and ``least``.
    """
    out = np.empty_like(x)
    _begin(state, 0.0, x[0], 0.0)
    for i in range(x.size):
        if x[i] != state[LAST]:
            u = _unloaded(state[LEVEL], state[LAST] + least, x[i] + least, share)
            state[LEVEL], state[LAST] = u, x[i]
        out[i] = state[LEVEL]
    return out


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def unloading_force(reading: Array, gain: float, share: float, least: float) -> Array:
    """Inverse of y = f (1 + gain * unloading(f, share, least)), sample by sample (gain above -1).

    By false position with halved weights (Illinois; Dowell and Jarratt 1971), until the bracket or
    the misfit is :data:`EXACT` of the reading: some six evaluations where bisection takes thirty.
    """
    out = np.zeros_like(reading)
    u, last = 0.0, 0.0
    for i in range(reading.size):
        y = reading[i]
        low, high = min(y, y / (1.0 + gain)), max(y, y / (1.0 + gain))
        f = low
        if high > low:
            below = low * (1.0 + gain * _unloaded(u, last + least, low + least, share)) - y
            above = high * (1.0 + gain * _unloaded(u, last + least, high + least, share)) - y
            side = 0
            for _ in range(60):
                if not below < 0.0 < above:
                    f = low if abs(below) <= abs(above) else high
                    break
                f = (low * above - high * below) / (above - below)
                miss = f * (1.0 + gain * _unloaded(u, last + least, f + least, share)) - y
                if abs(miss) <= EXACT * abs(y) or high - low <= EXACT * abs(y):
                    break
                if miss > 0.0:
                    high, above = f, miss
                    below = 0.5 * below if side > 0 else below
                    side = 1
                else:
                    low, below = f, miss
                    above = 0.5 * above if side < 0 else above
                    side = -1
        u = _unloaded(u, last + least, f + least, share)
        last = f
        out[i] = f
    return out


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def play(x: Array, width: float, state: Array) -> Array:
    """Play operator of full ``width`` (Krasnosel'skii and Pokrovskii 1989), starting in the middle
    of the gap.
    """
    out = np.empty_like(x)
    _begin(state, 0.0, x[0], x[0])
    half = 0.5 * width
    for i in range(x.size):
        state[LEVEL] = max(x[i] - half, min(x[i] + half, state[LEVEL]))
        out[i] = state[LEVEL]
    return out


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def air_lag(
    t: Array,
    x: Array,
    tau_fall: float,
    tau_rise: float,
    band: float,
    emptying: float,
    state: Array,
) -> Array:
    """First-order lag behind a setpoint x (n,) Pa gauge, held between samples.

    One time constant towards lower and another towards higher values; slower by 1 + distance /
    ``band`` far from the aim, where a valve is wide open, and towards lower values by the absolute
    pressure to the power of ``emptying``.
    """
    out = np.empty_like(x)
    _begin(state, t[0], x[0], x[0])
    for i in range(x.size):
        y, aim = state[LEVEL], state[LAST]
        tau = tau_rise
        if aim < y:
            tau = tau_fall * max(1.0 + y / ATMOSPHERE, 1e-3) ** -emptying
        tau *= 1.0 + abs(aim - y) / band
        y += (aim - y) * (1.0 - np.exp(-(t[i] - state[TIME]) / tau))
        out[i] = y
        state[LEVEL], state[LAST], state[TIME] = y, x[i], t[i]
    return out
