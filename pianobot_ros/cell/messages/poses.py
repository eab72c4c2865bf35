"""Poses, and the one policy for quaternions.

A quaternion is a rotation if it is finite and of length 1 within 1 %; the rest is rounding. Where
it commands, any other one is refused; where it was measured, the sample is dropped and counted. No
other rotation is put in its place.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.cell.arrays import Array

__all__ = [
    "UNIT_TOLERANCE",
    "are_rotations",
    "is_rotation",
    "position",
    "quaternion",
    "rotation_vectors",
]


UNIT_TOLERANCE = 0.01
"""Largest departure of a quaternion's length from 1."""


def position(pose: Any) -> tuple[float, float, float]:
    """Position of a ``geometry_msgs/Pose``, m."""
    p = pose.position
    return p.x, p.y, p.z


def quaternion(pose: Any) -> tuple[float, float, float, float]:
    """Orientation of a ``geometry_msgs/Pose`` as x, y, z, w; it may be no rotation."""
    q = pose.orientation
    return q.x, q.y, q.z, q.w


def is_rotation(x: float, y: float, z: float, w: float) -> bool:
    """Whether the quaternion is a rotation."""
    return abs(math.hypot(x, y, z, w) - 1.0) < UNIT_TOLERANCE


def are_rotations(quaternions: Array) -> NDArray[np.bool_]:
    """Which quaternions (n, 4) are rotations (n,)."""
    with np.errstate(over="ignore", invalid="ignore"):
        off = np.abs(np.linalg.norm(quaternions, axis=1) - 1.0)
    return np.asarray(off < UNIT_TOLERANCE)


def rotation_vectors(quaternions: Array) -> Array:
    """Rotation vectors (n, 3), rad, of measured quaternions (n, 4) x, y, z, w; a row of NaN for
    each that is no rotation.
    """
    unit = are_rotations(quaternions)
    found = np.where(quaternions[unit, 3:] < 0.0, -1.0, 1.0) * quaternions[unit]
    sine = np.linalg.norm(found[:, :3], axis=1)
    small = sine < 1e-12
    factor = np.where(small, 2.0, 2.0 * np.arctan2(sine, found[:, 3]) / np.where(small, 1.0, sine))
    vectors = np.full((len(quaternions), 3), np.nan)
    vectors[unit] = factor[:, None] * found[:, :3]
    return vectors
