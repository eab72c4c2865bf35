"""Compiled recurrences of the laws that have memory. All run on samples x (n,) at increasing times
t (n,) s.

``state`` (STATE,) is what they remember: all 0 before the first sample. A signal that comes in
pieces, with one state, gives the same as the whole signal at once.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numba import njit

from pianobot_ros.cell.arrays import Array

ATMOSPHERE = 101_325.0  # Pa, standard
TIMES = 0.002 * 2.0 ** np.arange(14)
"""Time constants, s, of which a creep is made: from a sample of a sensor to half a minute."""
BEGUN, LEVEL, LAST, TIME = range(4)  # whether there was a sample; output, input, time of the last
CREPT = 4  # the first of a creep's own
STATE = CREPT + TIMES.size


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


@lru_cache(maxsize=256)
def creep_shares(tau: float, power: float) -> Array:
    """Shares (n,) of :data:`TIMES` in the creep ((1 + t/tau)^power - 1) / power, so that they add
    up to 1 after a second.

    Its rate is a mixture of exponentials, exp(-x t/tau) weighted by exp(-x) x^-power (Tschoegl
    1989, 4.1): a power of time, its logarithm (power 0), nearly one exponential (power below -2).
    """
    x = tau / TIMES
    logs = -x - power * np.log(x)
    share = np.exp(logs - logs.max())
    return np.asarray(share / np.sum(share * -np.expm1(-1.0 / TIMES)))


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def _growth(t: float, tau: float, power: float) -> float:
    y = np.log1p(t / tau)
    return float(y) if abs(power) < 1e-6 else float(np.expm1(power * y) / power)


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def creep(
    t: Array,
    x: Array,
    gains: Array,
    shares: Array,
    tau: float,
    power: float,
    undo: bool,
    state: Array,
) -> Array:
    """A load's reading (n,), or, to ``undo`` it, the load behind a reading x (n,): ``gains`` (2,)
    are how much it grows in a second by a creep that ends with the load, and by one that lasts
    (Boltzmann's superposition, each of :data:`TIMES` exact for a load that is linear between
    samples).
    """
    out = np.empty_like(x)
    _begin(state, t[0], 0.0, 0.0)
    decay, held = np.ones(TIMES.size), np.ones(TIMES.size)
    step, unit = 0.0, _growth(1.0, tau, power)
    lasts = gains[1] != 0.0
    for i in range(x.size):
        dt, last = t[i] - state[TIME], state[LAST]
        if lasts and dt > 0.0 and abs(dt - step) > 1e-9:
            step = dt
            for k in range(TIMES.size):
                decay[k] = np.exp(-dt / TIMES[k])
                held[k] = TIMES[k] / dt * (1.0 - decay[k])
        past, now = 0.0, 0.0  # of what has crept: from before, and per N of this sample
        for k in range(TIMES.size if lasts else 0):
            level = state[CREPT + k]
            if dt > 0.0:
                past += shares[k] * (last * held[k] + (level - last) * decay[k])
                now += shares[k] * (1.0 - held[k])
            else:
                past += shares[k] * level
        loaded, own = state[LEVEL] + dt, 1.0
        push = x[i] - gains[1] * past if undo else x[i]
        if push > 0.0:
            own += gains[0] * _growth(loaded, tau, power) / unit
        load = push / max(own + gains[1] * now, 0.1) if undo else push
        if load <= NOTHING:
            loaded, own = 0.0, 1.0
            load = push / max(own + gains[1] * now, 0.1) if undo else push
        out[i] = load if undo else load * (own + gains[1] * now) + gains[1] * past
        if lasts and dt > 0.0:
            for k in range(TIMES.size):
                level = state[CREPT + k]
                state[CREPT + k] = load - (load - last) * held[k] + (level - last) * decay[k]
        state[LEVEL], state[LAST], state[TIME] = loaded, load, t[i]
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
def unloading_force(
    reading: Array, gain: float, share: float, least: float, left: float, band: float, state: Array
) -> Array:
    """Inverse of y = f + gain * unloading(f, share, least) (f + left), sample by sample (gain above
    -1). Changes within ``band`` N are the sensor's noise and turn nothing round.

    By false position with halved weights (Illinois; Dowell and Jarratt 1971), until the bracket or
    the misfit is :data:`EXACT` of the reading: some six evaluations where bisection takes thirty.
    """
    out = np.zeros_like(reading)
    _begin(state, 0.0, 0.0, 0.0)
    u, last = state[LEVEL], state[LAST]
    for i in range(reading.size):
        y = reading[i] + left
        f = y / (1.0 + gain * u)
        if abs(f - left - last) > band:
            slack = band if f - left > last else -band
            f = _between(y, u, last + slack + left, gain, share, least - left)
            u = _unloaded(u, last + slack + least, f - left + least, share)
            last = f - left - slack
        out[i] = f - left
    state[LEVEL], state[LAST] = u, last
    return out


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def _between(y: float, u: float, last: float, gain: float, share: float, least: float) -> float:
    """The f of y = f (1 + gain * u(f)), after ``last``, with state u there."""
    low, high = min(y, y / (1.0 + gain)), max(y, y / (1.0 + gain))
    if high <= low:
        return float(low)
    below = low * (1.0 + gain * _unloaded(u, last + least, low + least, share)) - y
    above = high * (1.0 + gain * _unloaded(u, last + least, high + least, share)) - y
    side, f = 0, low
    for _ in range(60):
        if not below < 0.0 < above:
            return float(low if abs(below) <= abs(above) else high)
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
    return float(f)


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
def crept_back(t: Array, x: Array, least: float, back: float, tau: float, state: Array) -> Array:
    """What is left (n,) of a deviation that was whole when x (n,) last changed by more than
    ``least``: the share ``back`` of it goes with the time constant ``tau`` s.

    Beside a play's own its ``state`` holds when that was, and the x before.
    """
    out = np.empty_like(x)
    if state[CREPT] == 0.0:
        state[CREPT], state[TIME], state[CREPT + 1] = 1.0, t[0], x[0]
    for i in range(x.size):
        if abs(x[i] - state[CREPT + 1]) > least:
            state[TIME] = t[i]
        state[CREPT + 1] = x[i]
        out[i] = 1.0 - back * (1.0 - np.exp(-(t[i] - state[TIME]) / tau))
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
