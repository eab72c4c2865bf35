"""Laws 1 to 3 of the effects of sensing, and what the left-out ones of sensing and clock do."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pianobot_ros.cell.arrays import Array

__all__ = [
    "conductance",
    "disciplined",
    "drifting",
    "knee_curve",
    "log_curve",
    "loop_of_operators",
    "loop_of_state",
    "power_curve",
    "scanned",
    "soft_ceiling",
    "tanh_scale",
    "two_way_gain",
    "warming",
]


LOOP_FORCE = 1.5  # N over which a loop turns
WARMING_TIME = 30.0  # s
DRIFT_TIME = 60.0  # s in which a rate error doubles
DISCIPLINE_PERIOD, DISCIPLINE_SLEW = 4.0, 0.3  # s
CONTACT_GAP = 0.002  # m between the two contacts of a key
LOG_CURVE = 12.0  # slope at 0 over slope at 127, less 1


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def loop_of_state(memory: Array, f: float) -> float:
    """State in [-1, 1] of a loop that turns exponentially with the change of force (Duhem's model;
    Dahl 1968); ``memory[1]`` is the last force, N.
    """
    d = f - memory[1]
    if d != 0.0:
        end = 1.0 if d > 0.0 else -1.0
        memory[0] = end - (end - memory[0]) * math.exp(-abs(d) / LOOP_FORCE)
    state: float = memory[0]
    return state


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def loop_of_operators(memory: Array, f: float) -> float:
    """Force, N, after three play operators of 0.2, 0.8 and 2.0 N in parallel (Prandtl and
    Ishlinskii; Kuhnen 2003); their states are ``memory[4:7]``.
    """
    memory[4] = min(max(memory[4], f - 0.2), f + 0.2)
    memory[5] = min(max(memory[5], f - 0.8), f + 0.8)
    memory[6] = min(max(memory[6], f - 2.0), f + 2.0)
    mean: float = (memory[4] + memory[5] + memory[6]) / 3.0
    return mean


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def conductance(f: float, loss: float) -> float:
    """Reading, N, of a force through a divider whose resistor is too large: a hyperbola that loses
    ``loss`` at 5 N (Interlink, *FSR integration guide*).
    """
    loss = min(loss, 0.9)
    return f / (1.0 + f / 5.0 * loss / (1.0 - loss))


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def soft_ceiling(f: float, loss: float) -> float:
    """Reading, N, that falls short by a cubic term, ``loss`` at 5 N, and stays level beyond its
    maximum (first two terms of any odd soft limit).
    """
    top = 5.0 / math.sqrt(3.0 * max(loss, 1e-12))
    x = min(f, top)
    return x - loss * x * (x / 5.0) ** 2


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def two_way_gain(memory: Array, f: float, share: float) -> float:
    """Reading, N, of a force that falls along another curve than it rose, from the highest since
    the sensor was free: half way down by ``share`` of the highest too much, right at both ends (how
    data sheets define hysteresis: Interlink, *FSR integration guide*). ``memory[4]`` is the highest
    force, N.
    """
    memory[4] = max(memory[4], f) if f > 0.0 else 0.0
    if f <= 0.0:
        return f
    reading: float = f * (1.0 + 4.0 * share * (1.0 - f / memory[4]))
    return reading


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def tanh_scale(loss: float) -> float:
    """Force, N, over which a hyperbolic tangent bends that loses ``loss`` at 5 N. Bisection."""
    low, high = 1e-6, 20.0
    loss = min(loss, 0.9)
    for _ in range(50):
        u = 0.5 * (low + high)
        if 1.0 - math.tanh(u) / u > loss:
            high = u
        else:
            low = u
    return 5.0 / low


def log_curve(velocity: float) -> float:
    """A curve through 0 and 127 that goes with the logarithm of the speed, as those of reproducing
    pianos (Goebl and Bresin 2003).
    """
    x = min(max(velocity / 127.0, 0.0), 1.0)
    return 127.0 * math.log1p(LOG_CURVE * x) / math.log1p(LOG_CURVE)


def power_curve(velocity: float) -> float:
    """A keyboard's velocity curve as a power of 0.6 through 0 and 127 (touch curves of digital
    pianos: Goebl and Bresin 2003 measured such).
    """
    return 127.0 * float(min(max(velocity / 127.0, 0.0), 1.0) ** 0.6)


def knee_curve(velocity: float) -> float:
    """A curve of two straight pieces that meet at velocity 45 of 127, where it gives 70: what a
    table of three points makes.
    """
    return float(np.interp(velocity, [0.0, 45.0, 127.0], [0.0, 70.0, 127.0]))


def scanned(velocity: float, speed: float, period: float) -> float:
    """Velocity from the time between two contacts, counted in scans of ``period`` s (Moog and Rhea
    1990 describe such keyboards).
    """
    time = CONTACT_GAP / max(abs(speed), 1e-4)
    counted = max(round(time / period), 1) * period
    return velocity * time / counted if period < time else velocity * time / max(time, period)


def warming(time: Array) -> Array:
    """Integral (n,), s, of a rate error that grows to 1 while the crystal warms up (Vig 1992,
    *Introduction to quartz frequency standards*).
    """
    return np.asarray(time - WARMING_TIME * (1.0 - np.exp(-time / WARMING_TIME)))


def drifting(time: Array) -> Array:
    """Integral (n,), s, of a rate error that grows evenly and has doubled after a minute (quadratic
    clock: Allan 1987, *Time and frequency characterization*).
    """
    return np.asarray(time + 0.5 * time * time / DRIFT_TIME)


def disciplined(time: Array) -> Array:
    """Error (n,), 0 to 1, of a clock that runs off for 4 s and is slewed back in 0.3 s, again and
    again (NTP: Mills 1991).
    """
    phase = np.mod(time, DISCIPLINE_PERIOD + DISCIPLINE_SLEW)
    off = phase / DISCIPLINE_PERIOD
    back = (DISCIPLINE_PERIOD + DISCIPLINE_SLEW - phase) / DISCIPLINE_SLEW
    return np.asarray(np.minimum(off, back))
