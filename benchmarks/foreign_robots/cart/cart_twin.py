"""Twin of the drivetrain of a small wheeled robot: voltage, current, wheel, tyre, body, with a
ground-speed sensor and an accelerometer.

A permanent-magnet motor behind a gear, a tyre whose force grows with slip speed, and rolling
resistance of the body.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from foreign_robots.twin_tools import (
    Array,
    BlockCache,
    effect,
    lagged,
    magnitude,
    nuisance,
    packed,
    smoothed,
)
from pianobot_ros.gap import Block, Observable, Signal, Stage

ELECTRICAL_TIME = 0.004  # s
INERTIA = 0.02  # kg m², of motor, gear and wheel
G = 9.81  # m/s²
NOMINAL_RADIUS = 0.1  # m
HORIZON = 60  # samples
WHOLE_BLOCK = 10**6  # samples
SUB_STEPS = 5


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def motor_current(t: Array, voltage: Array, wheel: Array, motor: Array, size: Array) -> Array:
    """Current (A) by voltage (V) and measured wheel speed (rad/s)."""
    resistance, constant, drop_size, heating = motor[0], motor[1], size[0], size[1]
    out = np.empty(t.size)
    current = (voltage[0] - constant * wheel[0]) / resistance
    heat = 0.0
    dt = t[1] - t[0]
    h = dt / SUB_STEPS
    a = 1 - math.exp(-h / ELECTRICAL_TIME)
    for k in range(t.size):
        out[k] = current
        if k == t.size - 1:
            break
        for j in range(SUB_STEPS):
            x = (j + 0.5) / SUB_STEPS
            u = voltage[k] + (voltage[k + 1] - voltage[k]) * x
            w = wheel[k] + (wheel[k + 1] - wheel[k]) * x
            warm = resistance * (1 + heating * heat)
            drop = drop_size * math.tanh(current / 0.3)
            current += a * ((u - constant * w - drop) / warm - current)
            heat += h * current * current / 100.0
    return out


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def wheel_speed(
    t: Array, current: Array, wheel: Array, speed: Array, span: int, cart: Array, size: Array
) -> Array:
    """Wheel speed (rad/s) by measured current, from the measured state every ``span`` samples."""
    constant, b, r, stiffness, m, rolling = cart[0], cart[1], cart[2], cart[3], cart[4], cart[5]
    friction, saturation, grade, drag, magnets = size[0], size[1], size[2], size[3], size[4]
    out = np.empty(t.size)
    w, v = wheel[0], speed[0]
    dt = t[1] - t[0]
    h = dt / SUB_STEPS
    for k in range(t.size):
        if k % span == 0:
            w, v = wheel[k], speed[k]
        out[k] = w
        if k == t.size - 1:
            break
        for j in range(SUB_STEPS):
            x = (j + 0.5) / SUB_STEPS
            i = current[k] + (current[k + 1] - current[k]) * x
            slip = r * w - v
            force = stiffness * slip / (1 + saturation * abs(stiffness * slip))
            torque = (
                constant * i * (1 - magnets * abs(i))
                - b * w
                - friction * math.tanh(w / 0.5)
                - r * force
            )
            slope = stiffness / (1 + saturation * abs(stiffness * slip)) ** 2
            w += h * torque / INERTIA / (1 + h * (b + r * r * slope) / INERTIA)
            slip = r * w - v
            force = stiffness * slip / (1 + saturation * abs(stiffness * slip))
            resistance = rolling * m * G * math.tanh(v / 0.05)
            v += h * (force - resistance - m * G * grade - drag * v * abs(v)) / m
    return out


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def body_acceleration(slip: float, v: float, cart: Array, size: Array) -> float:
    """Acceleration (m/s²) of the body by slip speed and speed (m/s)."""
    stiffness, m, rolling = cart[3], cart[4], cart[5]
    saturation, grade, drag = size[1], size[2], size[3]
    force = stiffness * slip / (1 + saturation * abs(stiffness * slip))
    resistance = rolling * m * G * math.tanh(v / 0.05)
    return float((force - resistance - m * G * grade - drag * v * abs(v)) / m)


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def body_motion(
    t: Array, wheel: Array, first_speed: float, cart: Array, size: Array
) -> tuple[Array, Array]:
    """Speed (m/s) and acceleration (m/s²) by measured wheel speed (rad/s)."""
    r, stiffness, m, saturation = cart[2], cart[3], cart[4], size[1]
    speed, acceleration = np.empty(t.size), np.empty(t.size)
    v = first_speed
    dt = t[1] - t[0]
    h = dt / SUB_STEPS
    for k in range(t.size):
        speed[k] = v
        acceleration[k] = body_acceleration(r * wheel[k] - v, v, cart, size)
        if k == t.size - 1:
            break
        for j in range(SUB_STEPS):
            x = (j + 0.5) / SUB_STEPS
            w = wheel[k] + (wheel[k + 1] - wheel[k]) * x
            slip = r * w - v
            slope = stiffness / (1 + saturation * abs(stiffness * slip)) ** 2
            a = body_acceleration(slip, v, cart, size)
            v += h * a / (1 + 0.5 * h * slope / m)
    return speed, acceleration


class CartSignals(NamedTuple):
    """What a block says, in SI units."""

    t: Array
    command_t: Array
    voltage: Array
    current: Array
    wheel: Array
    smooth_wheel: Array
    smooth_speed: Array


def signals_of(block: Block) -> CartSignals:
    """The signals, some of them smoothed."""
    outputs, command = block.outputs, block.inputs["u"]
    t, wheel, speed = outputs["w"].t, outputs["w"].y, outputs["v"].y
    dt = float(t[1] - t[0])
    return CartSignals(
        t,
        command.t,
        command.y,
        outputs["i"].y.copy(),
        wheel.copy(),
        smoothed(wheel, dt, 0, 11, 2),
        smoothed(speed, dt, 0, 11, 2),
    )


class CartTwin:
    """Current from voltage, wheel from current, speed and acceleration from the wheel."""

    stages = (
        Stage("driver"),
        Stage("motor"),
        Stage("gearbox"),
        Stage("tyre"),
        Stage("body"),
        Stage("sensors"),
    )
    observables = (
        Observable("current", "driver", "i", "A", floor_hint=0.01, tolerance=0.03),
        Observable("wheel", "gearbox", "w", "rad/s", floor_hint=0.02, tolerance=0.05),
        Observable(
            "wheel_short", "gearbox", "w", "rad/s", mode="horizon", floor_hint=0.02, tolerance=0.05
        ),
        Observable("speed", "tyre", "v", "m/s", floor_hint=0.002, tolerance=0.004),
        Observable("accel", "body", "a", "m/s2", floor_hint=0.01, tolerance=0.04),
    )
    parameters = (
        nuisance("R", 0.8, "ohm", "motor"),
        nuisance("ke", 1.0, "V s/rad", "motor", 0.08),
        nuisance("b", 0.06, "N m s", "gearbox"),
        nuisance("r", 0.1, "m", "tyre", 0.02),
        nuisance("C", 300.0, "N s/m", "tyre"),
        nuisance("m", 18.0, "kg", "body"),
        nuisance("crr", 0.03, "1", "body"),
    )
    effects = (
        effect(
            "driver_drop",
            "driver",
            magnitude("vd", 0.4, 4, "V"),
            (0.15, 0.8),
            "voltage lost in the driver by current direction",
        ),
        effect(
            "command_delay",
            "driver",
            magnitude("delay", 0.02, 0.2, "s"),
            (0.005, 0.03),
            "voltage comes late",
        ),
        effect(
            "winding_heat",
            "motor",
            magnitude("heat", 0.2, 3, "1/100 A2s"),
            (0.1, 0.5),
            "resistance grows with heat",
        ),
        effect(
            "magnet_saturation",
            "motor",
            magnitude("msat", 0.006, 0.03, "1/A"),
            (0.003, 0.01),
            "torque constant falls with current",
        ),
        effect(
            "gear_friction",
            "gearbox",
            magnitude("tc", 0.4, 4, "N m"),
            (0.1, 0.6),
            "Coulomb friction of the gear",
        ),
        effect(
            "tyre_saturation",
            "tyre",
            magnitude("tsat", 0.01, 0.2, "1/N"),
            (0.003, 0.02),
            "tyre force saturates with slip",
        ),
        effect(
            "grade",
            "body",
            magnitude("grade", 0.02, 0.2, "1", signed=True),
            (-0.02, 0.02),
            "the floor is not level",
        ),
        effect(
            "air_drag",
            "body",
            magnitude("drag", 1.0, 20, "N s2/m2"),
            (0.5, 3.0),
            "drag by speed squared",
        ),
        effect(
            "speed_sensor_lag",
            "sensors",
            magnitude("vlag", 0.03, 0.4, "s"),
            (0.01, 0.05),
            "ground-speed sensor lags",
        ),
        effect(
            "imu_pitch",
            "sensors",
            magnitude("pitch", 0.02, 0.3, "s2/m", signed=True),
            (-0.02, 0.02),
            "body pitches under acceleration: IMU reads gravity",
        ),
    )

    def __init__(self) -> None:
        self.signals = BlockCache(signals_of)

    def simulate(
        self, blocks: Sequence[Block], values: Mapping[str, float], effects: Sequence[str]
    ) -> list[dict[str, Array]]:
        """Current, wheel speed, speed and acceleration of every block."""
        motor, motor_size = packed(values, "R", "ke"), packed(values, "vd", "heat")
        cart = packed(values, "ke", "b", "r", "C", "m", "crr")
        size = packed(values, "tc", "tsat", "grade", "drag", "msat")
        delay, lag, pitch = packed(values, "delay", "vlag", "pitch")
        out = []
        for s in map(self.signals, blocks):
            voltage = np.interp(s.t - delay, s.command_t, s.voltage)
            # The true speed is ahead of a sensor that lags.
            ahead = lag * np.gradient(s.smooth_speed, s.t) if lag else 0.0
            speed = s.smooth_speed + ahead
            state = (s.current, s.smooth_wheel, speed)
            seen_speed, acceleration = body_motion(s.t, s.wheel, float(speed[0]), cart, size)
            out.append(
                {
                    "current": motor_current(s.t, voltage, s.wheel, motor, motor_size),
                    "wheel": wheel_speed(s.t, *state, WHOLE_BLOCK, cart, size),
                    "wheel_short": wheel_speed(s.t, *state, HORIZON, cart, size),
                    "speed": lagged(seen_speed, float(s.t[1] - s.t[0]), lag),
                    "accel": acceleration * (1 + G * pitch),
                }
            )
        return out

    def features(self, block: Block) -> dict[str, Signal]:
        """Speeds, current, slip, the way and the wheel's angle, and time."""
        o = block.outputs
        t = o["w"].t
        dt = t[1] - t[0]
        turned = np.cumsum(o["w"].y) * dt
        return {
            "wheel speed": o["w"],
            "speed": o["v"],
            "current": o["i"],
            "slip": Signal(t, NOMINAL_RADIUS * o["w"].y - o["v"].y),
            "distance": Signal(t, np.cumsum(o["v"].y) * dt),
            "wheel angle": Signal(t, np.mod(turned, 2 * np.pi)),
            "time": Signal(t, t),
        }
