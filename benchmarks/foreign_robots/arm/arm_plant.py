"""The arm itself: midpoint rule at 0.25 ms, drives at 4 kHz, other laws than the twin's.

Friction by bristles is Dahl's (1968) with the steady state of Stribeck; the bristles' state is
exact in travelled distance.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numba import njit

from foreign_robots.plant_tools import (
    Array,
    PlantLaw,
    correlated_noise,
    jittered,
    polled,
    session,
    sizes_by_place,
    stepping_times,
)
from pianobot_ros.gap import Block, Signal

SAMPLE, SAMPLES, STEP = 0.004, 180, 0.00025  # s, 1, s
PACKET = 0.004  # s
PARAMETERS = ("a1", "a2", "a3", "g1", "g2", "b1", "b2", "kp1", "kp2", "kd1", "kd2")
SLOSHING = 2 * math.pi * 3  # rad/s

LAWS = {
    "shoulder_bristles": PlantLaw(
        "friction1", 0.02, 8, "LuGre/Dahl bristles with Stribeck, shoulder"
    ),
    "shoulder_bearing": PlantLaw(
        "friction1", 0.02, 8, "Stribeck friction that grows with gravity load, shoulder"
    ),
    "elbow_bristles": PlantLaw("friction2", 0.01, 4, "LuGre/Dahl bristles with Stribeck, elbow"),
    "elbow_asymmetric": PlantLaw(
        "friction2", 0.01, 4, "direction-dependent Stribeck friction, elbow"
    ),
    "cable_slack": PlantLaw(
        "cable2", 0.02, 8, "cable that pulls beyond 0.2 rad only, quadratic onset"
    ),
    "cable_cubic": PlantLaw("cable2", 0.02, 8, "hardening cable (linear + cubic)"),
    "polled_command": PlantLaw("command_delay", 0.0005, 0.08, "commands polled every T"),
    "jittered_command": PlantLaw("command_delay", 0.0003, 0.04, "queued packets with gamma delays"),
    "hard_clip": PlantLaw("current_limit", 0.01, 1.0, "hard clip at 1/size A"),
    "fold_back": PlantLaw(
        "current_limit", 0.03, 1.0, "soft knee, then a third of the slope, at 1/size A"
    ),
    "saturation_tanh": PlantLaw("magnet_saturation", 0.005, 0.25, "torque = kt tanh(s i)/s"),
    "saturation_knee": PlantLaw(
        "magnet_saturation", 0.01, 0.5, "torque constant drops 30 % beyond knee 1/s A"
    ),
    "ripple_triangular": PlantLaw(
        "encoder_ripple2", 0.00002, 0.01, "triangular encoder error, 16 per turn"
    ),
    "ripple_two_harmonics": PlantLaw(
        "encoder_ripple2", 0.00002, 0.01, "encoder error 16 and 32 per turn"
    ),
    "wall": PlantLaw("unknown:wall", 1, 400, "elbow touches a padded stop beyond 0.75 rad"),
    "coupling": PlantLaw(
        "unknown:coupling",
        0.001,
        0.6,
        "elbow acceleration lag couples elastically: shoulder speed drags the elbow wiring"
        " (v^2 sign)",
    ),
    "shaker": PlantLaw("unknown:shaker", 0.01, 8, "11 Hz torque on its own clock at the shoulder"),
    "slosh": PlantLaw(
        "unknown:slosh", 0.005, 3.0, "bottle half full at the tip, sloshing oscillator 3 Hz"
    ),
}
(
    SHOULDER_BRISTLES,
    SHOULDER_BEARING,
    ELBOW_BRISTLES,
    ELBOW_ASYMMETRIC,
    CABLE_SLACK,
    CABLE_CUBIC,
    POLLED_COMMAND,
    JITTERED_COMMAND,
    HARD_CLIP,
    FOLD_BACK,
    SATURATION_TANH,
    SATURATION_KNEE,
    RIPPLE_TRIANGULAR,
    RIPPLE_TWO_HARMONICS,
    WALL,
    COUPLING,
    SHAKER,
    SLOSH,
) = range(len(LAWS))


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def encoder_reading(q: float, v: float, size: Array) -> tuple[float, float]:
    """The elbow's position (rad) and speed (rad/s) as its encoder has them."""
    if size[RIPPLE_TRIANGULAR] > 0:
        x = (16 * q + 0.7) / (2 * math.pi)
        x = x - math.floor(x)
        rate = 4.0 if x > 0.5 else -4.0
        return (
            q + size[RIPPLE_TRIANGULAR] * (4 * abs(x - 0.5) - 1),
            v + size[RIPPLE_TRIANGULAR] * (16 * v / (2 * math.pi)) * rate,
        )
    if size[RIPPLE_TWO_HARMONICS] > 0:
        error = size[RIPPLE_TWO_HARMONICS]
        rate = 16 * math.cos(16 * q + 0.4) + 9.6 * math.cos(32 * q)
        return (
            q + error * (math.sin(16 * q + 0.4) + 0.3 * math.sin(32 * q)),
            v + error * v * rate,
        )
    return q, v


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def limited_current(current: float, size: Array) -> float:
    """The current (A) that a drive lets through."""
    if size[HARD_CLIP] > 0:
        limit = 1 / size[HARD_CLIP]
        current = min(max(current, -limit), limit)
    if size[FOLD_BACK] > 0:
        limit = 1 / size[FOLD_BACK]
        if abs(current) > limit:
            current = math.copysign(limit + (abs(current) - limit) * 0.35, current)
    return current


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def motor_torque(constant: float, current: float, size: Array) -> float:
    """Torque (N m) of a motor whose magnets saturate or do not."""
    if size[SATURATION_TANH] > 0:
        return float(constant * math.tanh(size[SATURATION_TANH] * current) / size[SATURATION_TANH])
    if size[SATURATION_KNEE] > 0:
        knee = 1 / size[SATURATION_KNEE]
        if abs(current) > knee:
            return constant * math.copysign(knee + 0.7 * (abs(current) - knee), current)
    return constant * current


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def bristles(z: float, v: float) -> float:
    """The bristles' state after a step at speed ``v`` (rad/s)."""
    if v == 0:
        return z
    return math.copysign(1.0, v) + (z - math.copysign(1.0, v)) * math.exp(-abs(v) * STEP / 0.002)


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def friction_torques(
    q1: float, v1: float, v2: float, z1: float, z2: float, size: Array
) -> tuple[float, float]:
    """Friction of shoulder and elbow (N m)."""
    f1 = f2 = 0.0
    if size[SHOULDER_BRISTLES] > 0:
        f1 += size[SHOULDER_BRISTLES] * (0.85 + 0.4 * math.exp(-((v1 / 0.1) ** 2))) * z1
    if size[SHOULDER_BEARING] > 0:
        load = 0.3 + 0.7 * abs(math.cos(q1)) + 0.3 * math.exp(-abs(v1) / 0.1)
        f1 += size[SHOULDER_BEARING] * load * math.tanh(v1 / 0.008)
    if size[ELBOW_BRISTLES] > 0:
        f2 += size[ELBOW_BRISTLES] * (0.85 + 0.4 * math.exp(-((v2 / 0.1) ** 2))) * z2
    if size[ELBOW_ASYMMETRIC] > 0:
        stribeck = (1.2 if v2 > 0 else 0.8) + 0.3 * math.exp(-abs(v2) / 0.1)
        f2 += size[ELBOW_ASYMMETRIC] * stribeck * math.tanh(v2 / 0.008)
    return f1, f2


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def elbow_load(q2: float, v1: float, v2: float, size: Array) -> float:
    """Torque (N m) against the elbow of cable, stop and wiring."""
    load = 0.0
    if size[CABLE_SLACK] > 0 and q2 > 0.2:
        load += size[CABLE_SLACK] * (q2 - 0.2) * min(1.0, (q2 - 0.2) / 0.2)
    if size[CABLE_CUBIC] > 0:
        load += size[CABLE_CUBIC] * (0.6 * q2 + 0.8 * q2**3)
    if size[WALL] > 0 and q2 > 0.75:
        load += size[WALL] * ((q2 - 0.75) + 0.02 * max(v2, -0.2))
    if size[COUPLING] > 0:
        load += size[COUPLING] * v1 * abs(v1)
    return load


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def accelerations(
    q1: float,
    q2: float,
    v1: float,
    v2: float,
    torque: tuple[float, float],
    friction: tuple[float, float],
    disturbance: tuple[float, float],
    shaken: float,
    sloshed: float,
    arm: Array,
    size: Array,
) -> tuple[float, float]:
    """Of shoulder and elbow (rad/s²), by the motors' torques and what acts against them (N m)."""
    a1, a2, a3, g1, g2, b1, b2 = arm[0], arm[1], arm[2], arm[3], arm[4], arm[5], arm[6]
    h = -a2 * math.sin(q2)
    gravity2 = g2 * math.cos(q1 + q2)
    t1 = h * (2 * v1 * v2 + v2 * v2) + g1 * math.cos(q1) + gravity2 + b1 * v1 + friction[0]
    t1 = t1 - disturbance[0]
    t2 = -h * v1 * v1 + gravity2 + b2 * v2 + friction[1] - disturbance[1]
    t2 += elbow_load(q2, v1, v2, size)
    t1 += shaken
    c = a2 * math.cos(q2)
    m11 = a1 + a3 + 2 * c
    m12 = a3 + c
    if size[SLOSH] > 0:
        t2 -= size[SLOSH] * sloshed * SLOSHING**2 * 0.4
        t1 -= size[SLOSH] * sloshed * SLOSHING**2
    determinant = m11 * a3 - m12 * m12
    r1, r2 = torque[0] - t1, torque[1] - t2
    return (a3 * r1 - m12 * r2) / determinant, (m11 * r2 - m12 * r1) / determinant


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def balanced_start(command: Array, offset: Array, arm: Array) -> tuple[float, float]:
    """Positions (rad) at which the drives hold the arm up, and what it is off them."""
    q1, q2 = command[0, 0] + offset[0], command[1, 0] + offset[1]
    for _ in range(30):
        gravity2 = arm[4] * math.cos(q1 + q2)
        gravity1 = arm[3] * math.cos(q1) + gravity2
        q1 = command[0, 0] - gravity1 / 4.0 / arm[7]
        q2 = command[1, 0] - gravity2 / 2.0 / arm[8]
    return q1 + offset[0], q2 + offset[1]


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def move(
    command: Array,
    rate: Array,
    disturbance: Array,
    arm: Array,
    size: Array,
    offset: Array,
    phase: float,
) -> Array:
    """Measured positions (rad) and currents (A) of both joints (4, n) at every step, from commands,
    their rates and disturbing torques (N m), (2, n) each.
    """
    out = np.zeros((4, command.shape[1]))
    q1, q2 = balanced_start(command, offset, arm)
    v1 = v2 = z1 = z2 = s = sv = shaken = 0.0
    for k in range(command.shape[1]):
        seen, seen_speed = encoder_reading(q2, v2, size)
        i1 = arm[7] * (command[0, k] - q1) + arm[9] * (rate[0, k] - v1)
        i2 = arm[8] * (command[1, k] - seen) + arm[10] * (rate[1, k] - seen_speed)
        i1, i2 = limited_current(i1, size), limited_current(i2, size)
        out[0, k], out[1, k], out[2, k], out[3, k] = q1, seen, i1, i2
        torque = (motor_torque(4.0, i1, size), motor_torque(2.0, i2, size))
        z1, z2 = bristles(z1, v1), bristles(z2, v2)
        friction = friction_torques(q1, v1, v2, z1, z2, size)
        pushed = (disturbance[0, k], disturbance[1, k])
        if size[SHAKER] > 0:
            shaken = size[SHAKER] * math.sin(2 * math.pi * 11 * k * STEP + phase)
        a1, a2 = accelerations(q1, q2, v1, v2, torque, friction, pushed, shaken, s, arm, size)
        g = STEP * 0.5
        middle1, middle2 = v1 + g * a1, v2 + g * a2
        a1, a2 = accelerations(
            q1 + g * v1,
            q2 + g * v2,
            middle1,
            middle2,
            torque,
            friction,
            pushed,
            shaken,
            s,
            arm,
            size,
        )
        q1 += STEP * middle1
        q2 += STEP * middle2
        v1, v2 = v1 + STEP * a1, v2 + STEP * a2
        if size[SLOSH] > 0:
            sv += STEP * (-SLOSHING * SLOSHING * s - 0.1 * SLOSHING * sv - a1 - 0.4 * a2)
            s += STEP * sv
    return out


def minimum_jerk(t: Array, first: float, last: float, start: float, duration: float) -> Array:
    """From ``first`` to ``last`` (rad) by the minimum-jerk profile (Flash and Hogan 1985)."""
    s = np.clip((t - start) / duration, 0, 1)
    return np.asarray(first + (last - first) * (10 * s**3 - 15 * s**4 + 6 * s**5))


# Shoulder from and to, elbow from and to (rad), duration (s).
MOVES = (
    (0.2, 0.9, -0.2, 0.5, 0.45),
    (0.9, 0.2, 0.6, -0.3, 0.4),
    (-0.3, 0.5, 0.9, 0.1, 0.35),
    (0.6, -0.2, 0.1, 0.85, 0.5),
    (0.0, 0.0, -0.5, 0.7, 0.3),
    (0.1, 1.1, 0.3, 0.3, 0.4),
)
CONDITIONS = len(MOVES) + 2


def commanded(t: Array, condition: int) -> tuple[Array, Array]:
    """Commands of shoulder and elbow (rad): a move, or a sine of one of them."""
    if condition < len(MOVES):
        a, b, c, d, duration = MOVES[condition]
        return minimum_jerk(t, a, b, 0.06, duration), minimum_jerk(t, c, d, 0.10, duration)
    envelope = minimum_jerk(t, 0, 1, 0.0, 0.4)
    if condition == len(MOVES):
        return 0.3 + 0.2 * np.sin(2 * np.pi * 2.5 * t) * envelope, 0.2 + 0.0 * t
    return 0.3 + 0 * t, 0.3 + 0.4 * np.sin(2 * np.pi * 2.5 * t) * envelope


def received(
    t: Array, commands: Sequence[Array], size: Array, random: np.random.Generator
) -> tuple[Array, Array]:
    """Commands and their rates as the drives get them, (2, n) each."""
    rates = [np.gradient(c, STEP) for c in commands]
    if period := float(size[POLLED_COMMAND]):
        phase = random.uniform()
        commands = [polled(t, c, period, phase) for c in commands]
        rates = [polled(t, r, period, phase) for r in rates]
    elif mean := float(size[JITTERED_COMMAND]):
        seed = int(random.integers(1 << 30))

        def late(y: Array) -> Array:
            return jittered(t, y, mean, np.random.default_rng(seed), PACKET)

        commands, rates = [late(c) for c in commands], [late(r) for r in rates]
    return np.array(commands), np.array(rates)


def record(
    parameters: Mapping[str, float], effects: Mapping[str, float], seed: int, repeats: int = 4
) -> list[Block]:
    """Blocks of every condition, ``repeats`` times, with these laws at these sizes."""
    size, t = sizes_by_place(LAWS, effects), stepping_times(SAMPLES, SAMPLE, STEP)
    return session(record_move, parameters, size, t, seed, CONDITIONS, repeats)


def record_move(
    parameters: Mapping[str, float],
    size: Array,
    t: Array,
    which: tuple[int, int],
    seed: tuple[int, int],
) -> Block:
    """One block: ``which`` repeat and condition, with noise by ``seed``."""
    repeat, condition = which
    random, random_of_laws = np.random.default_rng(seed), np.random.default_rng([*seed, 7])
    scale = 1 + 0.01 * random.standard_normal()
    shift = 0.001 * random.standard_normal()
    c1, c2 = (x[0] + (x - x[0]) * scale for x in commanded(t - shift, condition))
    command, rate = received(t, (c1, c2), size, random_of_laws)
    disturbance = np.array(
        [
            correlated_noise(random, t.size, STEP, sd, 0.08) + offset * random.standard_normal()
            for sd, offset in ((0.12, 0.05), (0.06, 0.03))
        ]
    )
    arm = np.array([parameters[n] for n in PARAMETERS])
    arm[5:7] *= 1 + 0.03 * random.standard_normal(2)
    start = 2e-4 * random.standard_normal(2)
    phase = random_of_laws.uniform(0, 6.28)
    out = move(command, rate, disturbance, arm, size, start, phase)
    every = round(SAMPLE / STEP)
    stamps = t[::every]
    q1, q2 = (
        np.round((y[::every] + 3e-5 * random.standard_normal(SAMPLES)) / 5e-5) * 5e-5
        for y in out[:2]
    )
    i1, i2 = (y[::every] + 0.03 * random.standard_normal(SAMPLES) for y in out[2:])
    return Block(
        f"{condition}.{repeat}",
        f"move{condition}",
        {"c1": Signal(stamps, c1[::every], "rad"), "c2": Signal(stamps, c2[::every], "rad")},
        {
            "q1": Signal(stamps, q1, "rad"),
            "q2": Signal(stamps, q2, "rad"),
            "i1": Signal(stamps, i1, "A"),
            "i2": Signal(stamps, i2, "A"),
        },
        attributes={"span1": float(np.ptp(c1)), "span2": float(np.ptp(c2))},
    )
