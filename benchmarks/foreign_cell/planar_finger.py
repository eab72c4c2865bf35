"""The middle finger as a planar chain of phalanges, and the laws of its joints, compiled.

The coordinates are the absolute pitches of the phalanges (rad, downwards). The mass matrix depends
on them, with its centrifugal terms (Lagrange's equations of an open chain; Siciliano and others
2009, *Robotics*). Springs and dampers of the joints enter the matrix of the linearly implicit
midpoint rule.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from foreign_cell.law_table import (
    JAMMING_HYSTERESIS,
    JOINT_BACKLASH,
    JOINT_CREEP,
    JOINT_FRICTION,
    JOINT_HARDENING,
    JOINT_QUADRATIC_DAMPING,
    TIP_OFFSET,
)
from pianobot_ros.cell.arrays import Array, IntArray
from pianobot_ros.cell.motion.geometry import hand

__all__ = [
    "JOINT_MEMORY",
    "Finger",
    "Joints",
    "add_joints",
    "chain_equations",
    "middle_finger",
    "pad_offset",
    "solve",
    "tip_position",
    "tip_velocity",
]

JOINT_MEMORY = 13
"""Length of a joint's memory: bristle, play, six grains or one, five branches of creep."""
_BRISTLE, _PLAY, _GRAINS, _CREEP = 0, 1, 2, 8
_YIELD = np.array([0.004, 0.009, 0.016, 0.025, 0.036, 0.05])  # rad at which each grain slips
_CREEP_TIME = np.array([0.02, 0.08, 0.3, 1.2, 4.0])  # s
_CREEP_SHARE = np.array([0.28, 0.26, 0.22, 0.15, 0.09])
_THRELFALL_SPEED = 0.02  # rad/s
_PRESLIDING = 0.0015  # rad of a bristle's deflection where it slips
_OVERSTRESS_TIME = 0.03  # s


class Finger(NamedTuple):
    """Numbers of the chain.

    Attributes:
        pitch: of each phalanx at rest (4,), rad.
        bend: angle of each joint at rest (4,), rad.
        length: of the phalanges (4,), m.
        inertia: A_ij of the kinetic energy sum_ij A_ij cos(phi_i - phi_j) phi_i' phi_j' / 2 (4, 4),
            kg m^2.
        moment: mass times lever of the weight by phalanx (4,), kg m.
        radius: of the phalanges and so of the tip, m.
    """

    pitch: Array
    bend: Array
    length: Array
    inertia: Array
    moment: Array
    radius: float


class Joints(NamedTuple):
    """Joints at one time: ``stiffness`` N m/rad, ``damping`` N m s/rad, ``vacuum`` in 100 kPa."""

    stiffness: float
    damping: float
    vacuum: float


def middle_finger() -> Finger:
    """The middle finger of the configuration in force: phalanges are cylinders with a half sphere
    at both ends, whose inertia about their own centre is 83/320 m r^2, 3/8 r beyond the cylinder's
    end (textbook of mechanics). The pad is a point mass at the tip.
    """
    model = hand()
    finger = model.fingers["middle"]
    pitch = finger.pitch + np.concatenate([[0.0], np.cumsum(finger.bends)])
    length, radius, density = np.array(finger.lengths), finger.radius, model.density
    cylinder = density * math.pi * radius * radius * length
    sphere = density * 4 / 3 * math.pi * radius**3
    mass = cylinder + sphere
    central = cylinder * (length * length / 12 + radius * radius / 4)
    central = central + 2 * (sphere / 2) * (
        83 / 320 * radius * radius + (length / 2 + 3 * radius / 8) ** 2
    )
    first = mass * length / 2
    about_base = central + mass * (length / 2) ** 2
    first[-1] += model.pad.mass * length[-1]
    about_base[-1] += model.pad.mass * length[-1] ** 2
    mass[-1] += model.pad.mass
    beyond = np.concatenate([np.cumsum(mass[::-1])[::-1][1:], [0.0]])
    moment = first + length * beyond
    inertia = np.zeros((4, 4))
    for i in range(4):
        inertia[i, i] = about_base[i] + length[i] ** 2 * beyond[i]
        for j in range(i + 1, 4):
            inertia[i, j] = inertia[j, i] = length[i] * moment[j]
    bend = np.concatenate([pitch[:1], pitch[1:] - pitch[:-1]])
    return Finger(pitch, bend, length, inertia, moment, radius)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def pad_offset(law: IntArray, size: Array, radius: float) -> tuple[float, float, float]:
    """Offset of the pad along and across the last phalanx, m, and the tip's radius, m: the pad is
    mounted 20 degrees off (law 1), or worn all around (law 2).
    """
    along, across = 0.0, 0.0
    if law[TIP_OFFSET] == 1:
        along, across = size[TIP_OFFSET] * 0.940, size[TIP_OFFSET] * 0.342
    elif law[TIP_OFFSET] == 2:
        radius = radius - size[TIP_OFFSET]
    return along, across, radius


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def tip_position(
    length: Array,
    offset: tuple[float, float],
    state: tuple[Array, Array],
    ahead: float,
    base: tuple[float, float],
    sine: Array,
    cosine: Array,
) -> tuple[float, float]:
    """Position forward and up of the tip's centre, m, at pitches and rates ``state`` taken
    ``ahead`` s; ``base`` is that of the finger's base. Fills ``sine`` and ``cosine`` (4,).
    """
    y, z = base
    pitch, rate = state
    for i in range(4):
        angle = pitch[i] + ahead * rate[i]
        sine[i] = math.sin(angle)
        cosine[i] = math.cos(angle)
        y += length[i] * cosine[i]
        z -= length[i] * sine[i]
    along, across = offset
    y += along * cosine[3] - across * sine[3]
    z -= along * sine[3] + across * cosine[3]
    return y, z


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def tip_velocity(
    length: Array,
    offset: tuple[float, float],
    rate: Array,
    rise: float,
    sine: Array,
    cosine: Array,
) -> tuple[float, float]:
    """Velocity forward and up of the tip's centre, m/s, whose base moves up at ``rise`` m/s."""
    forward, up = 0.0, rise
    for i in range(4):
        forward -= length[i] * sine[i] * rate[i]
        up -= length[i] * cosine[i] * rate[i]
    along, across = offset
    forward += (-along * sine[3] - across * cosine[3]) * rate[3]
    up += (-along * cosine[3] + across * sine[3]) * rate[3]
    return forward, up


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def chain_equations(
    finger: Finger,
    gravity: float,
    rate: Array,
    sine: Array,
    cosine: Array,
    matrix: Array,
    force: Array,
) -> None:
    """Fill the chain's part of ``matrix`` (5, 5) and ``force`` (5,) without joints and contact,
    whose last row and column stay free for the key. ``gravity`` m/s^2, with the base's acceleration
    added.
    """
    for i in range(4):
        torque = gravity * finger.moment[i] * cosine[i]
        for j in range(4):
            matrix[i, j] = finger.inertia[i, j] * (cosine[i] * cosine[j] + sine[i] * sine[j])
            torque -= (
                finger.inertia[i, j]
                * (sine[i] * cosine[j] - cosine[i] * sine[j])
                * rate[j]
                * rate[j]
            )
        force[i] = torque
        matrix[i, 4] = 0.0
        matrix[4, i] = 0.0


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def add_joints(
    finger: Finger,
    joints: Joints,
    laws: tuple[IntArray, Array],
    state: tuple[Array, Array],
    memory: Array,
    h: float,
    matrix: Array,
    force: Array,
) -> None:
    """Add the torques of all joints at the predicted midpoint, and their stiffness and damping.
    ``memory`` (4, JOINT_MEMORY) goes on by the step ``h``, s.
    """
    pitch, rate = state
    law, size = laws
    for i in range(4):
        speed = rate[i] - (rate[i - 1] if i else 0.0)
        angle = pitch[i] - (pitch[i - 1] if i else 0.0) - finger.bend[i] + 0.5 * h * speed
        elastic = _elastic_torque(law, size, joints, memory[i], angle, speed, h)
        friction, damping = _friction(law, size, joints.damping, memory[i], speed, h)
        torque = elastic + friction + damping * speed
        implicit = 0.5 * h * damping + 0.25 * h * h * joints.stiffness
        force[i] -= torque
        matrix[i, i] += implicit
        if i:
            force[i - 1] += torque
            matrix[i - 1, i - 1] += implicit
            matrix[i, i - 1] -= implicit
            matrix[i - 1, i] -= implicit


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _elastic_torque(
    law: IntArray,
    size: Array,
    joints: Joints,
    memory: Array,
    angle: float,
    speed: float,
    h: float,
) -> float:
    """Torque of a joint's spring, N m, bent by ``angle`` rad from rest at ``speed`` rad/s: linear,
    with backlash, hardening, jamming or creep.
    """
    stiffness = joints.stiffness
    torque = stiffness * angle
    gap = size[JOINT_BACKLASH]
    if law[JOINT_BACKLASH] == 1:  # a dead zone without corners
        torque = stiffness * (angle - gap * math.tanh(angle / gap))
    elif law[JOINT_BACKLASH] == 2:  # play operator (Krasnosel'skii and Pokrovskii 1989)
        if angle - memory[_PLAY] > gap:
            memory[_PLAY] = angle - gap
        elif angle - memory[_PLAY] < -gap:
            memory[_PLAY] = angle + gap
        torque = stiffness * memory[_PLAY]
    harder = size[JOINT_HARDENING]
    if law[JOINT_HARDENING] == 1:  # locks at an angle (limiting chain, as by Warner 1972)
        limit = 0.01 * (1.0 + harder) / harder
        torque = stiffness * angle / (1.0 - min(angle * angle, 0.9 * limit) / limit)
    elif law[JOINT_HARDENING] == 2 and angle < 0:
        torque = stiffness * (angle + harder * angle * abs(angle) / 0.1)
    if law[JAMMING_HYSTERESIS] > 0:
        share = size[JAMMING_HYSTERESIS] * (0.3 + 0.7 * joints.vacuum)
        strained = _grains(law[JAMMING_HYSTERESIS], memory, speed, h)
        torque = stiffness * ((1 - share) * angle + share * strained)
    if law[JOINT_CREEP] == 1:  # stretched exponential (Kohlrausch 1854) by a Prony series
        given = 0.0
        for k in range(5):
            memory[_CREEP + k] += (angle - memory[_CREEP + k]) * h / _CREEP_TIME[k]
            given += _CREEP_SHARE[k] * memory[_CREEP + k]
        torque -= stiffness * size[JOINT_CREEP] * given
    elif law[JOINT_CREEP] == 2:  # two branches that jamming holds back
        memory[_CREEP] += (angle - memory[_CREEP]) * h / 0.06
        memory[_CREEP + 1] += (angle - memory[_CREEP + 1]) * h / 1.5
        torque -= (
            stiffness
            * size[JOINT_CREEP]
            * (1 - 0.8 * joints.vacuum)
            * (0.6 * memory[_CREEP] + 0.4 * memory[_CREEP + 1])
        )
    return torque


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _grains(law: int, memory: Array, speed: float, h: float) -> float:
    """Elastic strain, rad, of jammed grains: the mean of six elements that slip (law 1; Iwan 1966),
    or one that flows beyond its yield point (law 2; Perzyna 1966).
    """
    if law == 1:
        strain = 0.0
        for k in range(6):
            free = memory[_GRAINS + k] + h * speed
            memory[_GRAINS + k] = min(max(free, -_YIELD[k]), _YIELD[k])
            strain += memory[_GRAINS + k] / 6
        return strain
    held = memory[_GRAINS]
    over = max(abs(held) - 0.004, 0.0)
    memory[_GRAINS] = held + h * (speed - math.copysign(over, held) / _OVERSTRESS_TIME)
    left: float = memory[_GRAINS]
    return left


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _friction(
    law: IntArray, size: Array, damping: float, memory: Array, speed: float, h: float
) -> tuple[float, float]:
    """Friction torque with a memory, N m, and the secant damping of what has none, N m s/rad: by
    Threlfall (1978; law 1), elasto-plastic by Dupont and others (2002; law 2), and a drag with the
    square of the speed.
    """
    torque = 0.0
    level = size[JOINT_FRICTION]
    if law[JOINT_FRICTION] == 1:
        fast = abs(speed)
        drag = level * (1 - math.exp(-3 * fast / _THRELFALL_SPEED))
        damping += drag / fast if fast > 1e-7 else level * 3 / _THRELFALL_SPEED
    elif law[JOINT_FRICTION] == 2:
        bent = memory[_BRISTLE]
        slip = 0.0
        if bent * speed > 0:
            if abs(bent) >= _PRESLIDING:
                slip = 1.0
            elif abs(bent) > 0.6 * _PRESLIDING:
                slip = 0.5 * (
                    1 + math.sin(math.pi * (abs(bent) - 0.8 * _PRESLIDING) / (0.4 * _PRESLIDING))
                )
        memory[_BRISTLE] = bent + h * speed * (1 - slip * abs(bent) / _PRESLIDING)
        torque = level / _PRESLIDING * memory[_BRISTLE]
    if law[JOINT_QUADRATIC_DAMPING] > 0:
        damping += size[JOINT_QUADRATIC_DAMPING] * abs(speed)
    return torque, damping


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def solve(matrix: Array, vector: Array, n: int) -> None:
    """Solve n linear equations in place by Gauss's elimination without pivots."""
    for i in range(n):
        inverse = 1.0 / matrix[i, i]
        for row in range(i + 1, n):
            factor = matrix[row, i] * inverse
            if factor != 0.0:
                for column in range(i + 1, n):
                    matrix[row, column] -= factor * matrix[i, column]
                vector[row] -= factor * vector[i]
    for i in range(n - 1, -1, -1):
        rest = vector[i]
        for column in range(i + 1, n):
            rest -= matrix[i, column] * vector[column]
        vector[i] = rest / matrix[i, i]
