"""How fast an arm may go towards a target that moves. In plain numbers, as small arrays would take
most of the time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from pianobot_ros.cell.motion.rotations import product, quaternion, rotation_vector

if TYPE_CHECKING:
    from pianobot_ros.devices.wrist.config import LimitsConfig

__all__ = [
    "TOLERANCE",
    "Both",
    "Vector",
    "bent",
    "braking",
    "difference",
    "moved",
    "shortened",
    "turn",
    "turned",
]

TOLERANCE = 1.02  # rounding in the stream must not count as a violation
_REST = (0.0, 0.0, 0.0)

Vector = Sequence[float]
Both = tuple[Vector, Vector]
"""Of the position, m or m/s, and of the rotation, rad or rad/s."""


def difference(end: Vector, start: Vector) -> Vector:
    """The way from ``start`` to ``end``."""
    return [a - b for a, b in zip(end, start, strict=True)]


def turn(start: Vector, end: Vector) -> Vector:
    """Rotation vector that leads from one rotation vector to another."""
    if tuple(start) == tuple(end):  # most of the time
        return _REST
    return rotation_vector(product(quaternion(end), quaternion([-c for c in start])))


def moved(position: Vector, velocity: Vector, dt: float) -> list[float]:
    """Where a position is after ``dt`` s."""
    return [p + v * dt for p, v in zip(position, velocity, strict=True)]


def turned(rotation: Vector, rate: Vector, dt: float) -> Vector:
    """What a rotation vector is after ``dt`` s."""
    return rotation_vector(product(quaternion([w * dt for w in rate]), quaternion(rotation)))


def bent(
    limits: LimitsConfig, way: Both, velocity: Both, drift: Both, dt: float
) -> tuple[tuple[Vector, str], tuple[Vector, str]]:
    """Velocity and rate for the next step of ``dt`` s towards a target ``way`` away that moves with
    ``drift``, each with the limit that bent it; empty if none did.
    """
    own = (
        (limits.speed, limits.acceleration),
        (limits.angular_speed, limits.angular_acceleration),
    )
    position, rotation = (
        _limited(w, v, d, dt, top=top, acceleration=acceleration)
        for w, v, d, (top, acceleration) in zip(way, velocity, drift, own, strict=True)
    )
    return position, rotation


def _limited(
    error: Vector, velocity: Vector, drift: Vector, dt: float, *, top: float, acceleration: float
) -> tuple[Vector, str]:
    """Velocity for the next step towards a target ``error`` away that moves with ``drift``, and
    which limit bent it.
    """
    wanted = [e / dt for e in error]
    step = acceleration * dt  # largest change of velocity in this step
    fast = math.hypot(*wanted) > top * TOLERANCE
    # Neither getting there nor, once there, going on with the target may take more than the step
    # allows.
    change = max(math.dist(wanted, velocity), math.dist(wanted, drift))
    hard = change > step * TOLERANCE
    if not fast and not hard:
        return wanted, ""
    distance = math.hypot(*error)
    # Approach so that half of the acceleration is enough to brake; the other half is for following
    # the target. The speed
    # is held over the whole step, hence half a step's braking less than the square-root law of
    # continuous time.
    closing = min(
        math.sqrt((step / 2.0) ** 2 + acceleration * distance) - step / 2.0, distance / dt
    )
    if distance > 0.0:
        wanted = [d + e / distance * closing for d, e in zip(drift, error, strict=True)]
    else:
        wanted = list(drift)
    wanted = shortened(wanted, top)
    change_of = shortened(difference(wanted, velocity), step)
    bent = [v + c for v, c in zip(velocity, change_of, strict=True)]
    return bent, "speed" if fast else "acceleration"


def braking(acceleration: float, room: float) -> float:
    """Speed from which half of the acceleration stops within the `room`; the other half is for
    getting there.
    """
    return math.sqrt(acceleration * max(room, 0.0))


def shortened(vector: Vector, length: float) -> list[float]:
    """The vector, no longer than ``length``."""
    size = math.hypot(*vector)
    return list(vector) if size <= length else [c * (length / size) for c in vector]
