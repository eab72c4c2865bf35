"""Rotations as plain numbers agree with scipy's, also where they are hardest: none at all, and half
a turn.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pianobot_ros.cell.motion.rotations import product, quaternion, rotation_vector

ANGLES = [0.0, 1e-9, 9e-5, 1.1e-4, 0.3, 2.0, np.pi - 1e-6, np.pi]


@pytest.mark.parametrize("angle", ANGLES)
def test_there_and_back(angle: float) -> None:
    for seed in range(20):
        axis = np.random.default_rng(seed).standard_normal(3)
        vector = angle * axis / np.linalg.norm(axis)
        unit = quaternion(vector.tolist())
        assert np.allclose(unit, Rotation.from_rotvec(vector).as_quat(), atol=1e-12)
        back = np.array(rotation_vector(unit))
        same = Rotation.from_rotvec(back) * Rotation.from_rotvec(vector).inv()
        assert same.magnitude() < 1e-9 and np.linalg.norm(back) <= np.pi + 1e-12
        assert np.allclose(
            rotation_vector(tuple(-c for c in unit)), back, atol=1e-6 if angle > 3.14 else 1e-12
        ) or (
            angle > 3.14  # of half a turn both vectors are right
        )


def test_products_are_those_of_scipy() -> None:
    for first, second in zip(
        Rotation.random(50, random_state=1), Rotation.random(50, random_state=2), strict=True
    ):
        found = product(tuple(first.as_quat()), tuple(second.as_quat()))
        assert (Rotation.from_quat(found) * (first * second).inv()).magnitude() < 1e-9
