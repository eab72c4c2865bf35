# ruff: noqa: PLR0912  (compiled code: flat functions over plain numbers are what the compiler turns
# into fast code)
"""The arm's height and the fingers' vacuum, as they follow their commands, compiled; and the arm's
slow wander.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from scipy.linalg import expm

from foreign_cell.law_table import Acting, Effects, acting
from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.numbers.nominal import wrist_servo
from pianobot_ros.cell.recordings.commands import CYCLE

__all__ = ["arm_heights", "slow_noise", "true_pressures", "wander"]

ATMOSPHERE = 101325.0  # Pa
_LAG, _LEAK, _HYSTERESIS, _LIMIT_CYCLE = range(4)
_AIR = {
    "pressure_lag": _LAG,
    "pressure_leak": _LEAK,
    "regulator_hysteresis": _HYSTERESIS,
    "pressure_limit_cycle": _LIMIT_CYCLE,
}


def arm_heights(targets: Array, effects: Effects, steps: int, h: float) -> tuple[Array, Array]:
    """Heights, m, and speeds, m/s, of the wrist at the ends of ``steps`` steps of ``h`` s (and at
    the start), which follows ``targets`` (n,), m, that hold for a controller's cycle each.
    """
    servo = wrist_servo()
    frequency, damping = servo.natural_frequency, servo.damping_ratio
    lag, detuned = acting(effects, "wrist_lag"), acting(effects, "servo_underdamped")
    if lag.law == 1:
        frequency = 2 / (2 / frequency + lag.strength)
    if detuned.law:
        damping = damping - detuned.strength
    system = np.array([[0, 1.0], [-frequency * frequency, -2 * damping * frequency]])
    delay = acting(effects, "wrist_delay")
    heights, speeds = _follow(targets, CYCLE, steps, expm(system * h), delay, lag, h)
    return heights, speeds


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _follow(
    targets: Array,
    cycle: float,
    steps: int,
    propagator: Array,
    delay: Acting,
    lag: Acting,
    h: float,
) -> tuple[Array, Array]:
    """The second-order servo, exact for a target that holds over a step (matrix exponential).

    Delay by law 1: dead time that drifts; by law 2: mean of the targets over twice the delay. Lag
    by law 2: a share of the target goes through a first-order lag.
    """
    height, speed = np.empty(steps + 1), np.empty(steps + 1)
    height[0] = targets[0]
    speed[0] = 0.0
    lagged = targets[0]
    last = len(targets) - 1
    for k in range(steps):
        t = (k + 0.5) * h
        if delay.law == 1:
            t -= delay.strength * (1.0 + 0.3 * math.sin(2 * math.pi * t / 7.0))
        if delay.law == 2:
            at = t - 2 * delay.strength
            target = 0.0
            while at < t - 1e-12:
                i = math.floor(at / cycle + 1e-9)
                following = min((i + 1) * cycle, t)
                target += (following - at) * targets[min(max(i, 0), last)]
                at = following
            target /= 2 * delay.strength
        else:
            i = math.floor(t / cycle + 1e-9)
            target = targets[min(max(i, 0), last)]
        if lag.law == 2:
            lagged += (target - lagged) * (1 - math.exp(-h / (2.5 * lag.strength)))
            target = 0.6 * target + 0.4 * lagged
        off = height[k] - target
        height[k + 1] = target + propagator[0, 0] * off + propagator[0, 1] * speed[k]
        speed[k + 1] = propagator[1, 0] * off + propagator[1, 1] * speed[k]
    return height, speed


def true_pressures(setpoints: Array, effects: Effects, scatter: Array, tick: float) -> Array:
    """Gauge pressures (n, 3), Pa, at ticks of ``tick`` s that follow ``setpoints`` (n, 3), Pa;
    ``scatter`` (m, 3) from 0 to 1 is drawn anew at every step of a setpoint.
    """
    kind, how = -1, Acting(0, 0.0)
    for name, number in _AIR.items():
        if name in effects:
            kind, how = number, acting(effects, name)
    return np.asarray(_regulate(setpoints, kind, how.law, how.strength, scatter, tick))


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _regulate(
    setpoints: Array, kind: int, law: int, strength: float, scatter: Array, tick: float
) -> Array:
    """Pressures by the effect ``kind`` (-1: none).

    Lag: second order with overshoot, or a time that grows with depth (isothermal blow-down).
    Hysteresis: exponential loop (Coleman and Hodgdon 1986), or a controller's dead band. Leak:
    compressible laminar flow (Beater 2007), or droop of a P controller. Limit cycle: 2.7 Hz.
    """
    n = setpoints.shape[0]
    out = np.empty((n, 3))
    for c in range(3):
        pressure, speed, leak = setpoints[0, c], 0.0, 0.0
        loop, valve, width = 0.0, setpoints[0, c], 1.0
        last, stepped, steps = setpoints[0, c], -10.0, 0
        for i in range(n):
            aim = setpoints[i, c]
            if aim != last:
                if kind == _HYSTERESIS and law == 1:
                    side = math.copysign(1.0, aim - last)
                    loop += (side - loop) * (1 - math.exp(-abs(aim - last) / 25000.0))
                stepped = i * tick
                steps += 1
                width = 0.7 + 0.6 * scatter[steps % len(scatter), c]
                last = aim
            if kind == _HYSTERESIS and law == 1:
                aim = aim - strength * loop
            elif kind == _HYSTERESIS:
                if aim - valve > strength * width:
                    valve = aim - strength * width
                elif aim - valve < -strength * width:
                    valve = aim + strength * width
                aim = valve
            if kind == _LAG and law == 1:
                natural = 1.4 / strength
                for _ in range(4):
                    speed += (
                        tick / 4 * (natural * natural * (aim - pressure) - 1.4 * natural * speed)
                    )
                    pressure += tick / 4 * speed
            elif kind == _LAG:
                deeper = ATMOSPHERE / (ATMOSPHERE + pressure + 20000.0)
                time = strength * (0.5 + 0.5 * deeper)
                pressure += (aim - pressure) * (1 - math.exp(-tick / time))
            else:
                pressure = aim
            shown = pressure
            if kind == _LEAK and law == 1:
                ratio = (ATMOSPHERE + pressure) / ATMOSPHERE
                leak += (strength * (1 - ratio * ratio) - leak) * tick / 0.06
                shown = pressure + leak
            elif kind == _LEAK:
                recovered = 0.7 + 0.9 * math.exp(-(i * tick - stepped) / 0.4)
                leak = strength * -pressure / 1e5 * recovered
                shown = pressure + leak
            elif kind == _LIMIT_CYCLE:
                swing = math.sin(2 * math.pi * 2.7 * i * tick + c)
                shown = pressure + strength * (-pressure / 1e5) * swing
            out[i, c] = min(shown, 0.0)
    return out


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def slow_noise(white: Array, step: float, time: float) -> Array:
    """Noise of unit variance with the correlation ``time``, s, from white noise (n,) every ``step``
    s (Uhlenbeck and Ornstein 1930).
    """
    out = np.empty(len(white))
    value = 0.0
    kept = math.exp(-step / time)
    fresh = math.sqrt(1 - kept * kept)
    for i in range(len(white)):
        value = kept * value + fresh * white[i]
        out[i] = value
    return out


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def wander(white: Array, step: float, time: float) -> Array:
    """Smooth noise of unit variance: white noise (n,) every ``step`` s through two equal lags of
    ``time`` s.
    """
    out = np.empty(len(white))
    first, second = 0.0, 0.0
    kick = 2.0 * math.sqrt(step / time)
    for i in range(len(white)):
        first += -first * step / time + kick * white[i]
        second += (first - second) * step / time
        out[i] = second
    return out
