"""Twin of a two-link planar arm in a vertical plane: commanded positions, a PD drive at each joint,
encoders and measured currents.

The rigid-body equations of two links (Craig, Introduction to Robotics) by their base parameters:
``a1``, ``a2``, ``a3`` of inertia and ``g1``, ``g2`` of gravity.
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
    magnitude,
    nuisance,
    packed,
    smoothed,
)
from pianobot_ros.gap import Block, Effect, Observable, Parameter, Signal, Stage

TORQUE_CONSTANTS = (4.0, 2.0)  # N m/A at the joint
RIPPLE_PER_TURN = 16.0
EDGE = 8  # samples at either end where smoothing is poor
HORIZON = 36  # samples
SUB_STEPS = 4


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def bias_torques(
    q1: float, q2: float, v1: float, v2: float, arm: Array, size: Array
) -> tuple[float, float]:
    """Everything but inertia (N m): Coriolis, gravity, friction, cable."""
    a2, g1, g2, b1, b2 = arm[1], arm[3], arm[4], arm[5], arm[6]
    friction1, friction2, cable, tilt = size[0], size[1], size[2], size[3]
    h = -a2 * math.sin(q2)
    coriolis1 = h * (2 * v1 * v2 + v2 * v2)
    coriolis2 = -h * v1 * v1
    gravity2 = g2 * math.cos(q1 + q2 + tilt)
    gravity1 = g1 * math.cos(q1 + tilt) + gravity2
    return (
        coriolis1 + gravity1 + b1 * v1 + friction1 * math.tanh(v1 / 0.02),
        coriolis2 + gravity2 + b2 * v2 + friction2 * math.tanh(v2 / 0.02) + cable * q2,
    )


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def torques_of_motion(q: Array, v: Array, a: Array, arm: Array, size: Array) -> Array:
    """Torques (N m) that a motion takes; ``q``, ``v`` and ``a`` (2, n)."""
    out = np.empty_like(q)
    a1, a2, a3 = arm[0], arm[1], arm[2]
    for k in range(q.shape[1]):
        bias1, bias2 = bias_torques(q[0, k], q[1, k], v[0, k], v[1, k], arm, size)
        c = a2 * math.cos(q[1, k])
        out[0, k] = bias1 + (a1 + a3 + 2 * c) * a[0, k] + (a3 + c) * a[1, k]
        out[1, k] = bias2 + (a3 + c) * a[0, k] + a3 * a[1, k]
    return out


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def motion_of_currents(
    q: Array, v: Array, current: Array, dt: float, arm: Array, size: Array
) -> Array:
    """Positions (rad) over short horizons, each from the measured state; arrays (2, n)."""
    out = np.empty_like(q)
    a1, a2, a3, saturation = arm[0], arm[1], arm[2], size[4]
    h = dt / SUB_STEPS
    x1 = x2 = v1 = v2 = 0.0
    n = q.shape[1]
    for k in range(n):
        if k % HORIZON == 0:
            x1, x2, v1, v2 = q[0, k], q[1, k], v[0, k], v[1, k]
        out[0, k] = x1
        out[1, k] = x2
        if k == n - 1:
            break
        for j in range(SUB_STEPS):
            w = (j + 0.5) / SUB_STEPS
            i1 = current[0, k] * (1 - w) + current[0, k + 1] * w
            i2 = current[1, k] * (1 - w) + current[1, k + 1] * w
            motor1 = TORQUE_CONSTANTS[0] * i1 * (1 - saturation * abs(i1))
            motor2 = TORQUE_CONSTANTS[1] * i2 * (1 - saturation * abs(i2))
            bias1, bias2 = bias_torques(x1, x2, v1, v2, arm, size)
            c = a2 * math.cos(x2)
            m11 = a1 + a3 + 2 * c
            m12 = a3 + c
            determinant = m11 * a3 - m12 * m12
            r1, r2 = motor1 - bias1, motor2 - bias2
            o1, o2 = v1, v2
            v1 += h * (a3 * r1 - m12 * r2) / determinant
            v2 += h * (m11 * r2 - m12 * r1) / determinant
            x1 += h * (v1 + o1) / 2
            x2 += h * (v2 + o2) / 2
    return out


class ArmSignals(NamedTuple):
    """What a block says of both joints: arrays (2, n), in SI units."""

    t: Array
    dt: float
    position: Array
    speed: Array
    acceleration: Array
    command_t: Array
    command: Array
    command_rate: Array
    current: Array


def signals_of(block: Block) -> ArmSignals:
    """Both joints' signals, smoothed."""
    outputs, inputs = block.outputs, block.inputs
    t = outputs["q1"].t
    dt = float(t[1] - t[0])
    position, speed, acceleration = (
        np.array([smoothed(outputs[n].y, dt, order) for n in ("q1", "q2")]) for order in range(3)
    )
    command_t = inputs["c1"].t
    command = np.array([inputs["c1"].y, inputs["c2"].y])
    rate = np.asarray(np.gradient(command, command_t, axis=1))
    current = np.array([outputs["i1"].y, outputs["i2"].y])
    return ArmSignals(t, dt, position, speed, acceleration, command_t, command, rate, current)


def without_ripple(s: ArmSignals, ripple: float, phase: float) -> tuple[Array, Array, Array]:
    """Position, speed and acceleration with the elbow encoder's error taken off."""
    q, v, a = s.position.copy(), s.speed.copy(), s.acceleration.copy()
    angle = RIPPLE_PER_TURN * q[1] + phase
    k = RIPPLE_PER_TURN * ripple
    a[1] = a[1] * (1 - k * np.cos(angle)) + RIPPLE_PER_TURN * k * np.sin(angle) * v[1] ** 2
    v[1] = v[1] * (1 - k * np.cos(angle))
    q[1] = q[1] - ripple * np.sin(angle)
    return q, v, a


def inner(y: Array) -> Array:
    """The samples away from the ends, in one piece."""
    return np.ascontiguousarray(y[:, EDGE:-EDGE])


def without_edges(y: Array) -> Array:
    """``y`` with its ends missing; in place."""
    y[:EDGE] = y[-EDGE:] = np.nan
    return y


class ArmTwin:
    """Drive currents from commands, load currents from motion, motion from currents."""

    stages = (Stage("drive"), Stage("joint1"), Stage("joint2"), Stage("encoder"))
    observables = (
        Observable("drive_current1", "drive", "i1", "A", floor_hint=0.01, tolerance=0.04),
        Observable("drive_current2", "drive", "i2", "A", floor_hint=0.01, tolerance=0.04),
        Observable(
            "load_current1", "joint1", "i1", "A", mode="inverse", floor_hint=0.01, tolerance=0.04
        ),
        Observable(
            "load_current2", "joint2", "i2", "A", mode="inverse", floor_hint=0.01, tolerance=0.04
        ),
        Observable(
            "motion1", "joint1", "q1", "rad", mode="horizon", floor_hint=1e-4, tolerance=3e-4
        ),
        Observable(
            "motion2", "joint2", "q2", "rad", mode="horizon", floor_hint=1e-4, tolerance=3e-4
        ),
    )
    parameters = (
        nuisance("a1", 0.9, "kg m2", "joint1"),
        nuisance("a2", 0.25, "kg m2", "joint2"),
        nuisance("a3", 0.18, "kg m2", "joint2"),
        nuisance("g1", 9.0, "N m", "joint1"),
        nuisance("g2", 3.5, "N m", "joint2"),
        nuisance("b1", 1.2, "N m s", "joint1"),
        nuisance("b2", 0.5, "N m s", "joint2"),
        nuisance("kp1", 100.0, "A/rad", "drive"),
        nuisance("kp2", 80.0, "A/rad", "drive"),
        nuisance("kd1", 10.0, "A s/rad", "drive"),
        nuisance("kd2", 7.0, "A s/rad", "drive"),
    )
    effects = (
        effect(
            "friction1",
            "joint1",
            magnitude("fc1", 0.8, 10, "N m"),
            (0.2, 1.0),
            "Coulomb friction of the shoulder",
        ),
        effect(
            "friction2",
            "joint2",
            magnitude("fc2", 0.4, 5, "N m"),
            (0.1, 0.5),
            "Coulomb friction of the elbow",
        ),
        effect(
            "cable2",
            "joint2",
            magnitude("kc2", 0.5, 8, "N m/rad", signed=True),
            (-0.6, 0.2, 0.8),
            "cable stiffness at the elbow",
        ),
        effect(
            "tilt",
            "joint1",
            magnitude("tilt", 0.03, 0.3, "rad", signed=True),
            (-0.03, 0.03),
            "the base leans",
        ),
        effect(
            "command_delay",
            "drive",
            magnitude("delay", 0.006, 0.08, "s"),
            (0.002, 0.008),
            "commands come late",
        ),
        effect(
            "current_limit",
            "drive",
            magnitude("clip", 0.08, 1.0, "1/A"),
            (0.04, 0.12),
            "the drive saturates",
        ),
        effect(
            "magnet_saturation",
            "joint1",
            magnitude("sat", 0.01, 0.04, "1/A"),
            (0.004, 0.015),
            "torque constant falls with current",
        ),
        Effect(
            "encoder_ripple2",
            "encoder",
            [
                magnitude("ripple", 0.0008, 0.01, "rad"),
                Parameter("ripple_phase", 0.0, -4.0, 4.0, "rad", sd=2.0),
            ],
            [{"ripple": 0.0005, "ripple_phase": x} for x in (-1.57, 0.0, 1.57, 3.14)],
            description="elbow encoder error, 16 per turn",
        ),
    )

    def __init__(self) -> None:
        self.signals = BlockCache(signals_of)

    def simulate(
        self, blocks: Sequence[Block], values: Mapping[str, float], effects: Sequence[str]
    ) -> list[dict[str, Array]]:
        """Both joints' currents and motions of every block."""
        arm = packed(values, "a1", "a2", "a3", "g1", "g2", "b1", "b2")
        size = packed(values, "fc1", "fc2", "kc2", "tilt", "sat")
        out = []
        for s in map(self.signals, blocks):
            predicted = self._drive_currents(s, values)
            ripple, phase = packed(values, "ripple", "ripple_phase")
            state = (s.position, s.speed, s.acceleration)
            if ripple:
                state = without_ripple(s, ripple, phase)
            predicted |= self._load_currents(state, arm, size)
            motion = np.full_like(state[0], np.nan)
            motion[:, EDGE:-EDGE] = motion_of_currents(
                inner(state[0]), inner(state[1]), inner(s.current), s.dt, arm, size
            )
            if ripple:
                motion[1] = motion[1] + ripple * np.sin(RIPPLE_PER_TURN * motion[1] + phase)
            out.append(predicted | {"motion1": motion[0], "motion2": motion[1]})
        return out

    @staticmethod
    def _drive_currents(s: ArmSignals, values: Mapping[str, float]) -> dict[str, Array]:
        """Currents (A) that the drives ask for, from commands and measured motion."""
        delay, clip = packed(values, "delay", "clip")
        out = {}
        for j, joint in enumerate(("1", "2")):
            command = np.interp(s.t - delay, s.command_t, s.command[j])
            rate = np.interp(s.t - delay, s.command_t, s.command_rate[j])
            u = values["kp" + joint] * (command - s.position[j])
            u = u + values["kd" + joint] * (rate - s.speed[j])
            out["drive_current" + joint] = without_edges(u / np.sqrt(1 + (clip * u) ** 2))
        return out

    @staticmethod
    def _load_currents(
        state: tuple[Array, Array, Array], arm: Array, size: Array
    ) -> dict[str, Array]:
        """Currents (A) that the motion takes."""
        torque = torques_of_motion(*state, arm, size)
        saturation = size[4]
        out = {}
        for j, joint in enumerate(("1", "2")):
            y = torque[j] / TORQUE_CONSTANTS[j]
            if saturation:
                root = np.sqrt(np.maximum(1 - 4 * saturation * np.abs(y), 0.01))
                y = np.sign(y) * (1 - root) / (2 * saturation)
            out["load_current" + joint] = without_edges(y)
        return out

    def features(self, block: Block) -> dict[str, Signal]:
        """Motion and current of both joints, and time."""
        s = self.signals(block)
        named = {
            "position1": s.position[0],
            "position2": s.position[1],
            "speed1": s.speed[0],
            "speed2": s.speed[1],
            "accel1": s.acceleration[0],
            "accel2": s.acceleration[1],
            "current1": s.current[0],
            "current2": s.current[1],
            "time": s.t,
        }
        return {name: Signal(s.t, y) for name, y in named.items()}
