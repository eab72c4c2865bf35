"""The stand itself: the classical Runge-Kutta rule at 0.25 ms, other laws than the twin's."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numba import njit

from foreign_robots.plant_tools import (
    Array,
    PlantLaw,
    correlated_noise,
    first_order_lag,
    moving_average,
    polled,
    second_order_lag,
    session,
    sizes_by_place,
    smooth_step,
    stepping_times,
)
from pianobot_ros.gap import Block, Signal

SAMPLE, SAMPLES, STEP = 0.005, 180, 0.00025  # s, 1, s
PARAMETERS = ("V", "R", "J", "kq", "b", "ct")
CONDITIONS = 8
SETTLING = 8000  # steps at the first throttle before a block begins
FIRST_SPEED = 300.0  # rad/s
RINGING = 2 * math.pi * 9  # rad/s

LAWS = {
    "polled_throttle": PlantLaw("esc_delay", 0.0005, 0.2, "ESC takes the throttle every T"),
    "slew_rate": PlantLaw(
        "esc_delay", 0.0005, 0.2, "ESC limits the slew of duty and adds a delay of a quarter"
    ),
    "duty_power": PlantLaw("throttle_curve", 0.003, 0.8, "duty = throttle^(1-s)"),
    "duty_sine": PlantLaw("throttle_curve", 0.003, 0.8, "duty bent by a sine (table)"),
    "battery_two_rc": PlantLaw(
        "battery_sag", 0.0005, 0.3, "battery with two RC links (0.08 s, 0.8 s)"
    ),
    "battery_charge": PlantLaw(
        "battery_sag",
        0.0005,
        0.3,
        "battery voltage falls with charge drawn and recovers in 0.5 s, square root",
    ),
    "bearing_bristles": PlantLaw("bearing_friction", 0.0001, 0.08, "bristles with Stribeck"),
    "bearing_load": PlantLaw(
        "bearing_friction", 0.0001, 0.08, "bearing friction that grows with thrust"
    ),
    "saturation_tanh": PlantLaw("magnet_saturation", 0.0008, 0.08, "torque = k tanh(s i)/s"),
    "saturation_knee": PlantLaw(
        "magnet_saturation", 0.008, 0.5, "torque constant falls by 40 % beyond 1/s A"
    ),
    "tip_tanh": PlantLaw("tip_loss", 0.0001, 0.005, "compressibility: thrust flattens (tanh)"),
    "tip_knee": PlantLaw(
        "tip_loss", 0.0008, 0.01, "stall: square law until 1/s rad/s, then linear"
    ),
    "inflow_by_speed": PlantLaw(
        "inflow_lag", 0.001, 0.3, "induced flow whose lag shortens with speed"
    ),
    "inflow_second_order": PlantLaw("inflow_lag", 0.001, 0.3, "second-order induced flow"),
    "creep_three_times": PlantLaw("cell_creep", 0.002, 0.6, "creep of three time scales"),
    "creep_of_loading": PlantLaw("cell_creep", 0.002, 0.6, "slow creep (0.8 s) only while loading"),
    "second_order_reading": PlantLaw("rpm_lag", 0.0005, 0.15, "second-order speed filter"),
    "averaged_reading": PlantLaw("rpm_lag", 0.0005, 0.15, "speed averaged over a window"),
    "desync": PlantLaw(
        "unknown:desync",
        0.1,
        12,
        "ESC loses voltage for 30 ms when passing 520 rad/s upward",
    ),
    "ringing_stand": PlantLaw("unknown:ring", 0.003, 0.9, "stand rings at 9 Hz, excited by thrust"),
    "gust": PlantLaw("unknown:gust", 0.004, 4, "7 Hz draught on the thrust on its own clock"),
    "rubbing_guard": PlantLaw(
        "unknown:ground",
        0.003,
        0.8,
        "rotor shaft rubs for 50 ms at the top speed (contact with the guard beyond 600 rad/s)",
    ),
}
(
    POLLED_THROTTLE,
    SLEW_RATE,
    DUTY_POWER,
    DUTY_SINE,
    BATTERY_TWO_RC,
    BATTERY_CHARGE,
    BEARING_BRISTLES,
    BEARING_LOAD,
    SATURATION_TANH,
    SATURATION_KNEE,
    TIP_TANH,
    TIP_KNEE,
    INFLOW_BY_SPEED,
    INFLOW_SECOND_ORDER,
    CREEP_THREE_TIMES,
    CREEP_OF_LOADING,
    SECOND_ORDER_READING,
    AVERAGED_READING,
    DESYNC,
    RINGING_STAND,
    GUST,
    RUBBING_GUARD,
) = range(len(LAWS))


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def duty_of(throttle: float, size: Array) -> float:
    """Share of the supply that the ESC lets through."""
    x = min(max(throttle, 0.0), 1.0)
    if size[DUTY_POWER] > 0 and x > 0:
        x = x ** (1 - size[DUTY_POWER])
    if size[DUTY_SINE] > 0:
        x = x + size[DUTY_SINE] * 0.25 * math.sin(math.pi * x) * (1.3 - 0.6 * x)
    return x


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def motor_torque(current: float, size: Array) -> float:
    """Torque (N m) of a motor whose magnets saturate or do not."""
    if size[SATURATION_TANH] > 0:
        return float(0.011 * math.tanh(size[SATURATION_TANH] * current) / size[SATURATION_TANH])
    if size[SATURATION_KNEE] > 0 and current > 1 / size[SATURATION_KNEE]:
        knee = 1 / size[SATURATION_KNEE]
        return float(0.011 * (knee + 0.6 * (current - knee)))
    return 0.011 * current


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def bearing_torque(w: float, bristles: float, stand: Array, size: Array) -> float:
    """Friction (N m) of the bearings, viscous part and all."""
    friction = stand[4] * w
    if size[BEARING_BRISTLES] > 0:
        stribeck = 0.9 + 0.5 * math.exp(-((w / 150.0) ** 2))
        friction += size[BEARING_BRISTLES] * stribeck * bristles
    if size[BEARING_LOAD] > 0:
        friction += size[BEARING_LOAD] * (0.4 + stand[5] * w * w / 4.0) * math.tanh(w / 5.0)
    if size[RUBBING_GUARD] > 0 and w > 600:
        friction += size[RUBBING_GUARD] * 0.05 * min(1.0, (w - 600) / 20)
    return float(friction)


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def static_thrust(w: float, constant: float, size: Array) -> float:
    """Thrust (N) at a rotor speed (rad/s) in settled flow."""
    if size[TIP_TANH] > 0:
        return float(constant * (math.tanh((size[TIP_TANH] * w) ** 2) / size[TIP_TANH] ** 2))
    if size[TIP_KNEE] > 0 and w > 1 / size[TIP_KNEE]:
        return float(constant * (2 * w / size[TIP_KNEE] - 1 / size[TIP_KNEE] ** 2))
    return constant * w * w


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def battery_rates(state: Array, size: Array, out: Array) -> float:
    """Voltage (V) that the battery and a lost commutation take; the rates of its two links."""
    i, s1, s2 = state[0], state[2], state[3]
    out[2] = out[3] = 0.0
    if size[BATTERY_TWO_RC] > 0:
        out[2] = (0.6 * size[BATTERY_TWO_RC] * i - s1) / 0.08
        out[3] = (0.8 * size[BATTERY_TWO_RC] * i - s2) / 0.8
        return float(s1 + s2)
    if size[BATTERY_CHARGE] > 0:
        out[2] = (size[BATTERY_CHARGE] * 4 * math.sqrt(max(i, 0.0)) - s1) / 0.5
        return float(s1)
    if size[DESYNC] > 0:
        return float(state[6])
    return 0.0


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def rates(
    state: Array,
    throttle: float,
    stand: Array,
    size: Array,
    bristles: float,
    disturbance: float,
    out: Array,
) -> float:
    """Time derivatives of current (A), rotor speed (rad/s), the battery's two links (V), induced
    flow as thrust (N) and its rate, into ``out``; returns the thrust (N) in settled flow.
    """
    voltage, resistance, inertia, drag, constant = stand[0], stand[1], stand[2], stand[3], stand[5]
    i, w, flow, flow_rate = state[0], state[1], state[4], state[5]
    left = voltage - battery_rates(state, size, out)
    out[0] = (left * duty_of(throttle, size) - 0.011 * w - resistance * i) / (0.002 * resistance)
    friction = bearing_torque(w, bristles, stand, size)
    out[1] = (motor_torque(i, size) - drag * w * w - friction + disturbance) / inertia
    thrust = static_thrust(w, constant, size)
    out[4] = out[5] = 0.0
    if size[INFLOW_BY_SPEED] > 0:
        out[4] = (thrust - flow) / (size[INFLOW_BY_SPEED] * 400.0 / max(w, 150.0))
    if size[INFLOW_SECOND_ORDER] > 0:
        pole = 2 / size[INFLOW_SECOND_ORDER]
        out[4] = flow_rate
        out[5] = (thrust - flow) * pole**2 - 2 * pole * flow_rate
    return float(thrust)


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def spin(throttle: Array, disturbance: Array, stand: Array, size: Array) -> Array:
    """Current (A), rotor speed (rad/s), thrust (N) and reaction torque (N m), (4, n), at every step
    after settling at the first throttle; the disturbance is a torque (N m).
    """
    h = STEP
    out = np.zeros((4, throttle.size))
    y = np.zeros(7)
    k1, k2, k3, k4 = np.zeros(7), np.zeros(7), np.zeros(7), np.zeros(7)
    y[1] = FIRST_SPEED
    bristles, timer = 1.0, 0.0  # the rotor never stops
    lagging = size[INFLOW_BY_SPEED] > 0 or size[INFLOW_SECOND_ORDER] > 0
    over = False
    for k in range(-SETTLING, throttle.size):
        c, pushed = throttle[max(k, 0)], disturbance[max(k, 0)]
        if k >= 0 and size[DESYNC] > 0:
            if y[1] > 520 and not over:
                timer = 0.03
                over = True
            if y[1] < 480:
                over = False
            y[6] = size[DESYNC] if timer > 0 else 0.0
            timer -= h
        thrust = rates(y, c, stand, size, bristles, pushed, k1)
        if k == -SETTLING:
            y[4] = thrust
        if k >= 0:
            out[0, k], out[1, k] = y[0], y[1]
            out[2, k] = y[4] if lagging else thrust
            out[3, k] = stand[3] * y[1] ** 2 + stand[2] * k1[1]
        rates(y + 0.5 * h * k1, c, stand, size, bristles, pushed, k2)
        rates(y + 0.5 * h * k2, c, stand, size, bristles, pushed, k3)
        rates(y + h * k3, c, stand, size, bristles, pushed, k4)
        y = y + h * (k1 + 2 * k2 + 2 * k3 + k4) / 6
    return out


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def rung(load: Array, share: float) -> Array:
    """A load of which that share goes through a hardly damped oscillator, the stand."""
    out = np.empty(load.size)
    x, v = load[0], 0.0
    for k in range(load.size):
        a = RINGING * RINGING * (load[k] - x) - 0.12 * RINGING * v
        v += STEP * a
        x += STEP * v
        out[k] = (1 - share) * load[k] + share * x
    return out


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def slewed(y: Array, most: float) -> Array:
    """``y`` that changes by so much a step at most."""
    out = np.empty(y.size)
    now = y[0]
    for k in range(y.size):
        now += min(max(y[k] - now, -most), most)
        out[k] = now
    return out


def commanded(t: Array, condition: int) -> Array:
    """Throttle (0 to 1) of a run."""
    sine = np.sin(2 * np.pi * 3 * (t - 0.05))
    up = smooth_step(t, 0.1, 0.05)
    return [
        0.3 + 0.2 * up,
        0.3 + 0.4 * smooth_step(t, 0.1, 0.1),
        0.7 - 0.35 * smooth_step(t, 0.1, 0.1),
        0.25 + 0.55 * smooth_step(t, 0.1, 0.7),
        0.4 + 0.3 * up - 0.3 * smooth_step(t, 0.5, 0.05),
        0.5 + 0.15 * sine * smooth_step(t, 0.05, 0.15),
        0.35 + 0.15 * up + 0.2 * smooth_step(t, 0.4, 0.05) - 0.25 * smooth_step(t, 0.65, 0.05),
        0.45 + 0 * t + 0.05 * smooth_step(t, 0.2, 0.05),
    ][condition]


def received(t: Array, throttle: Array, size: Array, random: np.random.Generator) -> Array:
    """The throttle as the ESC takes it."""
    if size[POLLED_THROTTLE]:
        throttle = polled(t, throttle, size[POLLED_THROTTLE], random.uniform())
    if late := size[SLEW_RATE]:
        most = 0.5 / max(late, 1e-3) * 0.35 * STEP
        throttle = slewed(np.interp(t - late / 4, t, throttle), most)
    return throttle


def load_cell(load: Array, tau: float, size: Array) -> Array:
    """What the load cell says of a load; ``tau`` (s) is its lag."""
    if creep := size[CREEP_THREE_TIMES]:
        fast, middle, slow = (first_order_lag(load, STEP, x) for x in (0.1, 0.4, 1.6))
        load = load + creep * (0.4 * fast + 0.4 * middle + 0.3 * slow)
    if creep := size[CREEP_OF_LOADING]:
        load = load + creep * np.minimum(first_order_lag(load, STEP, 0.8), load)
    if size[RINGING_STAND]:
        load = rung(load, size[RINGING_STAND])
    return first_order_lag(load, STEP, tau)


def record(
    parameters: Mapping[str, float], effects: Mapping[str, float], seed: int, repeats: int = 4
) -> list[Block]:
    """Blocks of every condition, ``repeats`` times, with these laws at these sizes."""
    size, t = sizes_by_place(LAWS, effects), stepping_times(SAMPLES, SAMPLE, STEP)
    return session(record_run, parameters, size, t, seed, CONDITIONS, repeats)


def record_run(
    parameters: Mapping[str, float],
    size: Array,
    t: Array,
    which: tuple[int, int],
    seed: tuple[int, int],
) -> Block:
    """One block: ``which`` repeat and condition, with noise by ``seed``."""
    repeat, condition = which
    random, random_of_laws = np.random.default_rng(seed), np.random.default_rng([*seed, 7])
    throttle = commanded(t, condition)
    taken = received(t, throttle, size, random_of_laws)
    stand = np.array([parameters[n] for n in PARAMETERS])
    stand[0] *= 1 + 0.003 * random.standard_normal()
    stand[5] *= 1 + 0.003 * random.standard_normal()
    disturbance = correlated_noise(random, t.size, STEP, 3e-4, 0.05)
    disturbance = disturbance + 1e-4 * random.standard_normal()
    current, speed, thrust, torque = spin(taken, disturbance, stand, size)
    thrust = thrust + correlated_noise(random, t.size, STEP, 0.02, 0.05)
    if size[GUST]:
        phase = random_of_laws.uniform(0, 6.28)
        thrust = thrust + size[GUST] * np.sin(2 * np.pi * 7 * t + phase)
    thrust, torque = (load_cell(y, parameters["cell"], size) for y in (thrust, torque))
    if size[SECOND_ORDER_READING]:
        speed = second_order_lag(speed, STEP, size[SECOND_ORDER_READING])
    if size[AVERAGED_READING]:
        speed = moving_average(speed, STEP, size[AVERAGED_READING])
    every = round(SAMPLE / STEP)
    stamps = t[::every]

    def measured(y: Array, sd: float, unit: str) -> Signal:
        return Signal(stamps, y[::every] + sd * random.standard_normal(SAMPLES), unit)

    return Block(
        f"{condition}.{repeat}",
        f"run{condition}",
        {"c": Signal(stamps, throttle[::every], "1")},
        {
            "i": measured(current, 0.15, "A"),
            "w": measured(speed, 1.0, "rad/s"),
            "f": measured(thrust, 0.02, "N"),
            "q": measured(torque, 4e-4, "N m"),
        },
        attributes={"throttle": float(throttle.max())},
    )
