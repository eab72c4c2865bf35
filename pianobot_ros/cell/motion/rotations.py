"""Rotations as plain numbers, for what happens in every cycle: a rotation of scipy costs more than
all the rest of a cycle, and its import half of the time that a killed driver needs to come back."""

from __future__ import annotations

import math
from collections.abc import Sequence

__all__ = ["Quaternion", "product", "quaternion", "rotation_vector"]

Quaternion = tuple[float, float, float, float]
"""x, y, z, w."""


def quaternion(vector: Sequence[float]) -> Quaternion:
    """Unit quaternion of a rotation vector (3,), rad."""
    a, b, c = vector
    angle = math.sqrt(a * a + b * b + c * c)
    k = 0.5 - angle * angle / 48.0 if angle < 1e-4 else math.sin(0.5 * angle) / angle
    return k * a, k * b, k * c, math.cos(0.5 * angle)


def product(first: Quaternion, second: Quaternion) -> Quaternion:
    """The rotation ``second`` followed, in fixed axes, by ``first``."""
    a, b, c, d = first
    e, f, g, h = second
    return (
        d * e + a * h + b * g - c * f,
        d * f - a * g + b * h + c * e,
        d * g + a * f - b * e + c * h,
        d * h - a * e - b * f - c * g,
    )


def rotation_vector(unit: Quaternion) -> tuple[float, float, float]:
    """Rotation vector of a unit quaternion, rad, of length at most pi."""
    x, y, z, w = unit
    if w < 0.0:
        x, y, z, w = -x, -y, -z, -w
    sine = math.sqrt(x * x + y * y + z * z)
    k = 2.0 if sine < 1e-12 else 2.0 * math.atan2(sine, w) / sine
    return k * x, k * y, k * z
