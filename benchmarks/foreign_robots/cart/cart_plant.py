"""The drivetrain itself: the classical Runge-Kutta rule at 0.5 ms, other laws than the twin's.

The tyre is a brush model or Pacejka's magic formula (Pacejka, Tire and Vehicle Dynamics); bristles
in the gear are LuGre's (Canudas de Wit and others 1995) with their damping left out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numba import njit

from foreign_robots.plant_tools import (
    Array,
    PlantLaw,
    correlated_noise,
    jittered,
    moving_average,
    polled,
    second_order_lag,
    session,
    sizes_by_place,
    smooth_step,
    stepping_times,
)
from pianobot_ros.gap import Block, Signal

SAMPLE, SAMPLES, STEP = 0.01, 180, 0.0005  # s, 1, s
PACKET = 0.01  # s
PARAMETERS = ("R", "ke", "b", "r", "C", "m", "crr")
CONDITIONS = 8

LAWS = {
    "gear_bristles": PlantLaw(
        "gear_friction", 0.003, 4, "LuGre bristles with Stribeck in the gear"
    ),
    "gear_load": PlantLaw(
        "gear_friction", 0.003, 4, "gear friction that grows with motor torque, Stribeck"
    ),
    "polled_voltage": PlantLaw("command_delay", 0.001, 0.3, "voltage polled every T"),
    "jittered_voltage": PlantLaw(
        "command_delay", 0.0005, 0.15, "queued voltage packets, gamma delays"
    ),
    "diode": PlantLaw("driver_drop", 0.01, 6, "logarithmic diode drop"),
    "dead_time": PlantLaw("driver_drop", 0.01, 6, "bridge dead time, saturating over 1 A"),
    "brush_tyre": PlantLaw("tyre_saturation", 0.001, 0.5, "brush tyre"),
    "magic_formula": PlantLaw("tyre_saturation", 0.001, 0.5, "magic formula with falling branch"),
    "second_order_sensor": PlantLaw("speed_sensor_lag", 0.002, 0.5, "second-order speed filter"),
    "averaging_sensor": PlantLaw(
        "speed_sensor_lag", 0.002, 0.5, "moving average in the speed sensor"
    ),
    "saturation_tanh": PlantLaw("magnet_saturation", 0.004, 0.4, "torque = k tanh(s i)/s"),
    "saturation_knee": PlantLaw(
        "magnet_saturation", 0.02, 1.0, "torque constant halves beyond a knee at 1/s A"
    ),
    "drag_power_1_5": PlantLaw("air_drag", 0.03, 40, "drag by speed to the 1.5"),
    "drag_cubed": PlantLaw("air_drag", 0.03, 40, "drag by speed cubed"),
    "oval_wheel": PlantLaw(
        "unknown:oval", 0.0005, 0.3, "oval wheel: radius follows twice the wheel angle"
    ),
    "ice": PlantLaw("unknown:ice", 0.05, 0.97, "slippery patch from 0.3 to 0.7 m"),
    "brake": PlantLaw("unknown:brake", 0.05, 8, "parking brake that lets go at 0.5 s over 0.2 s"),
    "gear_teeth": PlantLaw("unknown:teeth", 0.02, 10, "torque ripple 5 per wheel turn"),
}
(
    GEAR_BRISTLES,
    GEAR_LOAD,
    POLLED_VOLTAGE,
    JITTERED_VOLTAGE,
    DIODE,
    DEAD_TIME,
    BRUSH_TYRE,
    MAGIC_FORMULA,
    SECOND_ORDER_SENSOR,
    AVERAGING_SENSOR,
    SATURATION_TANH,
    SATURATION_KNEE,
    DRAG_POWER_1_5,
    DRAG_CUBED,
    OVAL_WHEEL,
    ICE,
    BRAKE,
    GEAR_TEETH,
) = range(len(LAWS))


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def tyre_force(slip: float, stiffness: float, way: float, size: Array) -> float:
    """Force (N) of the tyre at a slip speed (m/s), that far (m) from the start."""
    if size[ICE] > 0 and 0.3 < way < 0.7:
        stiffness = stiffness * (1 - size[ICE])
    if size[BRUSH_TYRE] > 0:
        most = 1 / size[BRUSH_TYRE]
        z = stiffness * slip / (3 * most)
        if abs(z) > 1:
            return math.copysign(most, slip)
        return float(3 * most * (z - abs(z) * z + z**3 / 3))
    if size[MAGIC_FORMULA] > 0:
        peak = 1 / size[MAGIC_FORMULA]
        return float(peak * math.sin(1.4 * math.atan(stiffness * slip / (1.4 * peak))))
    return stiffness * slip


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def driver_drop(current: float, size: Array) -> float:
    """Voltage (V) that the driver loses."""
    if size[DIODE] > 0:
        return math.copysign(
            size[DIODE] * math.log(1 + abs(current) / 0.1) / math.log(101.0), current
        )
    if size[DEAD_TIME] > 0:
        return float(size[DEAD_TIME] * current / (abs(current) + 1.0))
    return 0.0


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def motor_torque(constant: float, current: float, size: Array) -> float:
    """Torque (N m) of a motor whose magnets saturate or do not."""
    if size[SATURATION_TANH] > 0:
        return float(constant * math.tanh(size[SATURATION_TANH] * current) / size[SATURATION_TANH])
    if size[SATURATION_KNEE] > 0 and abs(current) > 1 / size[SATURATION_KNEE]:
        knee = 1 / size[SATURATION_KNEE]
        return constant * math.copysign(knee + 0.5 * (abs(current) - knee), current)
    return constant * current


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def gear_torque(current: float, w: float, z: float, size: Array) -> float:
    """Friction (N m) of the gear."""
    if size[GEAR_BRISTLES] > 0:
        return float(size[GEAR_BRISTLES] * (0.85 + 0.4 * math.exp(-((w / 1.0) ** 2))) * z)
    if size[GEAR_LOAD] > 0:
        load = 0.4 + 0.15 * abs(current) + 0.4 * math.exp(-abs(w) / 1.0)
        return float(size[GEAR_LOAD] * load * math.tanh(w / 0.1))
    return 0.0


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def rates(
    state: Array,
    voltage: float,
    cart: Array,
    size: Array,
    bristles: float,
    disturbance: tuple[float, float],
    time: float,
    out: Array,
) -> None:
    """Time derivatives of current (A), wheel speed (rad/s), speed (m/s), way (m) and angle (rad),
    into ``out``. The disturbance is a torque at the wheel and a force on the body.
    """
    resistance, constant, b, radius = cart[0], cart[1], cart[2], cart[3]
    stiffness, m, rolling = cart[4], cart[5], cart[6]
    i, w, v, way, angle = state[0], state[1], state[2], state[3], state[4]
    torque = motor_torque(constant, i, size) - gear_torque(i, w, bristles, size)
    if size[BRAKE] > 0:
        torque -= size[BRAKE] * math.tanh(w / 0.3) * min(1.0, max(0.0, (0.7 - time) / 0.2))
    if size[GEAR_TEETH] > 0:
        torque += size[GEAR_TEETH] * math.sin(5 * angle)
    rolling_radius = radius * (1 + size[OVAL_WHEEL] * math.sin(2 * angle + 0.5))
    force = tyre_force(rolling_radius * w - v, stiffness, way, size)
    against = rolling * m * 9.81 * math.tanh(v / 0.05)
    if size[DRAG_POWER_1_5] > 0:
        against += size[DRAG_POWER_1_5] * math.copysign(abs(v) ** 1.5, v)
    if size[DRAG_CUBED] > 0:
        against += size[DRAG_CUBED] * v**3 / 2
    left = voltage - constant * w - driver_drop(i, size) - resistance * i
    out[0] = left / (0.004 * resistance)
    out[1] = (torque + disturbance[0] - b * w - rolling_radius * force) / 0.02
    out[2] = (force + disturbance[1] - against) / m
    out[3] = v
    out[4] = w


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def drive(voltage: Array, torque: Array, force: Array, cart: Array, size: Array) -> Array:
    """Current (A), wheel speed (rad/s), speed (m/s) and acceleration (m/s²), (4, n), at every step
    from rest, by voltage (V), disturbing torque (N m) and force (N).
    """
    h = STEP
    out = np.zeros((4, voltage.size))
    y = np.zeros(5)
    k1, k2, k3, k4 = np.zeros(5), np.zeros(5), np.zeros(5), np.zeros(5)
    z = 0.0
    for k in range(voltage.size):
        after = voltage[min(k + 1, voltage.size - 1)]
        middle = 0.5 * (voltage[k] + after)
        pushed = (torque[k], force[k])
        rates(y, voltage[k], cart, size, z, pushed, k * h, k1)
        out[0, k], out[1, k], out[2, k], out[3, k] = y[0], y[1], y[2], k1[2]
        rates(y + 0.5 * h * k1, middle, cart, size, z, pushed, k * h, k2)
        rates(y + 0.5 * h * k2, middle, cart, size, z, pushed, k * h, k3)
        rates(y + h * k3, after, cart, size, z, pushed, k * h, k4)
        y = y + h * (k1 + 2 * k2 + 2 * k3 + k4) / 6
        if y[1] != 0:
            s = math.copysign(1.0, y[1])
            z = s + (z - s) * math.exp(-abs(y[1]) * h / 0.02)
    return out


def commanded(t: Array, condition: int) -> Array:
    """Voltage (V) of a drive."""
    sine = np.sin(2 * np.pi * 1.5 * (t - 0.5))
    return [
        8 * smooth_step(t, 0.1, 0.3),
        14 * smooth_step(t, 0.1, 0.6) - 14 * smooth_step(t, 1.2, 0.4),
        -9 * smooth_step(t, 0.1, 0.3),
        6 * smooth_step(t, 0.1, 0.2) + 8 * smooth_step(t, 0.9, 0.25),
        12 * smooth_step(t, 0.1, 0.25) - 18 * smooth_step(t, 0.9, 0.4),
        18 * smooth_step(t, 0.1, 1.4),
        8 * smooth_step(t, 0.1, 0.4) + 5 * sine * smooth_step(t, 0.5, 0.3),
        4 * smooth_step(t, 0.1, 0.2),
    ][condition]


def record(
    parameters: Mapping[str, float], effects: Mapping[str, float], seed: int, repeats: int = 4
) -> list[Block]:
    """Blocks of every condition, ``repeats`` times, with these laws at these sizes."""
    size, t = sizes_by_place(LAWS, effects), stepping_times(SAMPLES, SAMPLE, STEP)
    return session(record_drive, parameters, size, t, seed, CONDITIONS, repeats)


def record_drive(
    parameters: Mapping[str, float],
    size: Array,
    t: Array,
    which: tuple[int, int],
    seed: tuple[int, int],
) -> Block:
    """One block: ``which`` repeat and condition, with noise by ``seed``."""
    repeat, condition = which
    random, random_of_laws = np.random.default_rng(seed), np.random.default_rng([*seed, 7])
    voltage = commanded(t, condition) * (1 + 0.004 * random.standard_normal())
    received = voltage
    if size[POLLED_VOLTAGE]:
        received = polled(t, voltage, size[POLLED_VOLTAGE], random_of_laws.uniform())
    if size[JITTERED_VOLTAGE]:
        received = jittered(t, voltage, size[JITTERED_VOLTAGE], random_of_laws, PACKET)
    torque, force = (
        correlated_noise(random, t.size, STEP, sd, 0.1) + offset * random.standard_normal()
        for sd, offset in ((0.03, 0.01), (0.5, 0.2))
    )
    cart = np.array([parameters[n] for n in PARAMETERS])
    cart[0] *= 1 + 0.005 * random.standard_normal()
    cart[4] *= 1 + 0.005 * random.standard_normal()
    current, wheel, speed, acceleration = drive(received, torque, force, cart, size)
    if size[SECOND_ORDER_SENSOR]:
        speed = second_order_lag(speed, STEP, size[SECOND_ORDER_SENSOR])
    if size[AVERAGING_SENSOR]:
        speed = moving_average(speed, STEP, size[AVERAGING_SENSOR])
    every = round(SAMPLE / STEP)
    stamps = t[::every]

    def measured(y: Array, sd: float, unit: str) -> Signal:
        return Signal(stamps, y[::every] + sd * random.standard_normal(SAMPLES), unit)

    return Block(
        f"{condition}.{repeat}",
        f"drive{condition}",
        {"u": Signal(stamps, voltage[::every], "V")},
        {
            "i": measured(current, 0.06, "A"),
            "w": measured(wheel, 0.04, "rad/s"),
            "v": measured(speed, 0.006, "m/s"),
            "a": measured(acceleration, 0.08, "m/s2"),
        },
        attributes={"voltage": float(np.abs(voltage).max())},
    )
