"""The pad of the finger on the key: force along the key's normal, and friction, compiled.

The tip is a sphere on the key's top, which turns with the key. The pad never pulls. Friction is
Coulomb's, with a stiff tangential spring and damper while the pad sticks.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from numba import njit

from foreign_cell.law_table import PAD_COMPLIANCE, TIP_SLIP
from pianobot_ros.cell.arrays import Array, IntArray

__all__ = [
    "PAD_MEMORY",
    "Friction",
    "Pad",
    "add_contact",
    "contact_directions",
    "friction_force",
    "let_go",
    "move_pad",
    "pad_force",
    "pad_reading",
]

PAD_MEMORY = 4
"""Length of the pad's memory: stretch of the sticking pad, m; path slid, m; 1 while it slides; and
depth of the Maxwell branch, m.
"""
_STRETCH, _PATH, _SLIDING, _MAXWELL = range(4)
_STICK_STIFFNESS, _STICK_DAMPING = 1e5, 20.0  # N/m, N s/m
_SLIP_LENGTH = 0.0005  # m
_RELAXATION = 0.025  # s


class Pad(NamedTuple):
    """``stiffness`` N/m and ``damping`` N s/m of the pad, and its coefficient of ``friction``."""

    stiffness: float
    damping: float
    friction: float


class Friction(NamedTuple):
    """Friction ``force``, N, along the key; what it adds to the matrix by ``implicit`` (kg) and, as
    it ``slides``, by its ``ratio`` to the normal force.
    """

    force: float
    implicit: float
    ratio: float
    slides: bool


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def pad_force(
    law: IntArray, size: Array, pad: Pad, depth: float, opening: float, memory: Array, h: float
) -> tuple[float, float, float]:
    """Normal force, N, of a pad pressed by ``depth`` m that opens at ``opening`` m/s, and its
    stiffness and damping. Law 1: a blunt pad whose contact grows; law 2: standard linear solid
    (Zener 1948), whose branch in ``memory`` goes on by ``h`` s.
    """
    stiffness, damping = pad.stiffness, pad.damping
    give = size[PAD_COMPLIANCE]
    if law[PAD_COMPLIANCE] == 1:
        x = depth + give
        elastic = pad.stiffness * depth * depth / x
        stiffness = pad.stiffness * (depth * depth + 2 * depth * give) / (x * x)
        damping = pad.damping * stiffness / pad.stiffness
    elif law[PAD_COMPLIANCE] == 2:
        memory[_MAXWELL] = (memory[_MAXWELL] - h * opening) / (1 + h / _RELAXATION)
        elastic = pad.stiffness * ((1 - give) * depth + give * memory[_MAXWELL])
    else:
        elastic = pad.stiffness * depth
    return elastic - damping * opening, stiffness, damping


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def pad_reading(
    law: IntArray, size: Array, pad: Pad, depth: float, opening: float, memory: Array
) -> float:
    """The same force at a tick's end, where nothing moves on; 0 where it would pull."""
    if depth <= 0:
        return 0.0
    give = size[PAD_COMPLIANCE]
    if law[PAD_COMPLIANCE] == 1:
        x = depth + give
        slope = pad.damping * (depth * depth + 2 * depth * give) / (x * x)
        force = pad.stiffness * depth * depth / x - slope * opening
    elif law[PAD_COMPLIANCE] == 2:
        elastic = pad.stiffness * ((1 - give) * depth + give * memory[_MAXWELL])
        force = elastic - pad.damping * opening
    else:
        force = pad.stiffness * depth - pad.damping * opening
    pushing: float = max(force, 0.0)
    return pushing


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def friction_force(
    law: IntArray, size: Array, pad: Pad, force: float, speed: float, memory: Array, h: float
) -> Friction:
    """Friction along the key under the normal ``force``, N, at the sliding ``speed``, m/s. Law 1:
    static and kinetic Coulomb friction; law 2: it weakens with the path slid (Ida 1972).
    """
    limit = pad.friction * force
    if law[TIP_SLIP] == 1 and memory[_SLIDING] > 0.0:
        limit *= 1 - size[TIP_SLIP]
    elif law[TIP_SLIP] == 2:
        limit *= 1 - size[TIP_SLIP] * (1 - math.exp(-memory[_PATH] / _SLIP_LENGTH))
    held = -(_STICK_STIFFNESS * (memory[_STRETCH] + 0.5 * h * speed) + _STICK_DAMPING * speed)
    if abs(held) > limit:
        held = math.copysign(limit, held)
        return Friction(held, 0.0, math.copysign(limit / force, held), True)
    implicit = 0.5 * h * _STICK_DAMPING + 0.25 * h * h * _STICK_STIFFNESS
    return Friction(held, implicit, 0.0, False)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def move_pad(memory: Array, friction: Friction, speed: float, h: float) -> None:
    """What the touching pad remembers after a step of ``h`` s at the sliding ``speed``, m/s."""
    if friction.slides:
        memory[_STRETCH] = -friction.force / _STICK_STIFFNESS
        memory[_PATH] += abs(speed) * h
        memory[_SLIDING] = 0.0 if speed * friction.force > 0 else 1.0
    else:
        memory[_STRETCH] += h * speed
        if abs(speed) < 2e-4:
            memory[_SLIDING] = 0.0


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def let_go(memory: Array) -> None:
    """The pad is clear of the key and forgets."""
    memory[:] = 0.0


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def contact_directions(
    length: Array,
    offset: tuple[float, float],
    chain: tuple[Array, Array, Array],
    key: tuple[float, float, float],
    place: tuple[float, float],
    radius: float,
    rise: float,
    normal: Array,
    tangent: Array,
) -> tuple[float, float, float]:
    """Depth, m, and speeds of opening and of sliding, m/s, of the contact.

    ``chain`` are sine, cosine and rate of the phalanges, ``key`` sine, cosine and rate of the key,
    ``place`` the tip from the key's hinge, m. Fills the levers by which the chain's pitches and the
    key's angle move the contact along the key's ``normal`` and ``tangent`` (5,), m.
    """
    sine, cosine, rate = chain
    key_sine, key_cosine, key_rate = key
    y, z = place
    depth = -(-key_sine * y + key_cosine * z - radius)
    lever = -key_cosine * y - key_sine * z
    opening = key_cosine * rise + lever * key_rate
    sliding = key_sine * rise
    along, across = offset
    for i in range(4):
        forward, up = -length[i] * sine[i], -length[i] * cosine[i]
        if i == 3:
            forward += -along * sine[3] - across * cosine[3]
            up += -along * cosine[3] + across * sine[3]
        normal[i] = -key_sine * forward + key_cosine * up
        tangent[i] = key_cosine * forward + key_sine * up
        if i == 3:
            tangent[i] -= radius - 0.5 * max(depth, 0.0)
        opening += normal[i] * rate[i]
        sliding += tangent[i] * rate[i]
    normal[4] = lever
    tangent[4] = -0.5 * max(depth, 0.0)
    sliding += tangent[4] * key_rate
    return depth, opening, sliding


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def add_contact(
    normal: Array,
    tangent: Array,
    force: float,
    implicit: float,
    friction: Friction,
    matrix: Array,
    vector: Array,
) -> None:
    """Add the normal ``force``, N, with its ``implicit`` part, kg, and the friction to the
    equations of motion.
    """
    for i in range(5):
        vector[i] += normal[i] * force + tangent[i] * friction.force
        for j in range(5):
            matrix[i, j] += (
                normal[i] * implicit * normal[j] + tangent[i] * friction.implicit * tangent[j]
            )
            if friction.slides:
                matrix[i, j] += tangent[i] * friction.ratio * implicit * normal[j]
