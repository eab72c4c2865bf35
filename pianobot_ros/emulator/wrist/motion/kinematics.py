"""Kinematics and joint loads of the UR5 and UR5e.

Poses are arrays of shape (6,): position in metres and rotation vector in radians, of the flange in
the base frame. Joint angles are arrays of shape (6,), radians, in the controller's convention.

Sources: Universal Robots, "DH Parameters for calculations of kinematics and dynamics"; K. Hawkins,
"Analytic Inverse Kinematics for the Universal Robots UR-5/UR-10 Arms", Georgia Tech 2013.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.emulator.wrist.motion import kernel

__all__ = [
    "MODELS",
    "ArmGeometry",
    "Array",
    "Kinematics",
    "from_pose",
    "load_of",
    "to_pose",
    "to_rotvec",
    "transform",
]


CENTRES = (
    (0.0, -0.02561, 0.00193),
    (0.2125, 0.0, 0.11336),
    (0.15, 0.0, 0.0265),
    (0.0, -0.0018, 0.01634),
    (0.0, 0.0018, 0.01634),
    (0.0, 0.0, -0.001159),
)
"""Centres of mass of the links, m; the maker gives the same for both arms."""


@dataclass(frozen=True)
class ArmGeometry:
    """Denavit-Hartenberg parameters (m, rad), link masses (kg) with centres (m, link frames), and
    motor constants.

    ``torque_per_ampere`` is torque at the joint for one ampere in its motor, N m/A. Universal
    Robots publishes none: 13.3 (large joints) and 9.2 (small joints) are of the order that
    identification papers report, so currents of the emulated arm have plausible size but are no
    reference. ``inertia`` (kg m^2) and ``friction`` (N m s/rad) are likewise plausible.
    """

    name: str
    d: tuple[float, ...]
    a: tuple[float, ...]
    mass: tuple[float, ...]
    centre: tuple[tuple[float, float, float], ...] = CENTRES
    alpha: tuple[float, ...] = (math.pi / 2, 0.0, 0.0, math.pi / 2, -math.pi / 2, 0.0)
    torque_per_ampere: tuple[float, ...] = (13.3, 13.3, 13.3, 9.2, 9.2, 9.2)
    inertia: tuple[float, ...] = (2.5, 2.5, 1.2, 0.12, 0.12, 0.08)
    friction: tuple[float, ...] = (8.0, 8.0, 5.0, 1.5, 1.5, 1.0)


MODELS = {
    "UR5": ArmGeometry(
        name="UR5",
        d=(0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823),
        a=(0.0, -0.425, -0.39225, 0.0, 0.0, 0.0),
        mass=(3.7, 8.393, 2.33, 1.219, 1.219, 0.1879),
    ),
    "UR5e": ArmGeometry(
        name="UR5e",
        d=(0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996),
        a=(0.0, -0.425, -0.3922, 0.0, 0.0, 0.0),
        mass=(3.761, 8.058, 2.846, 1.37, 1.3, 0.365),
    ),
}

_GRAVITY = 9.81


def to_rotvec(rotation: Array) -> Array:
    """Rotation vector, shape (3,), of a rotation matrix, shape (3, 3). Its angle is in [0, pi]."""
    vector = np.empty(3)
    kernel.rotation_vector_of(_plain(rotation), vector)
    return vector


def transform(rotvec: Array) -> Array:
    """Rotation matrix, shape (3, 3), of a rotation vector, shape (3,)."""
    matrix = np.empty((3, 3))
    kernel.rotation_of(_plain(rotvec), matrix)
    return matrix


def from_pose(pose: Array) -> Array:
    """Homogeneous matrix, shape (4, 4), of a pose, shape (6,)."""
    matrix = np.empty((4, 4))
    kernel.place_of_pose(_plain(pose), matrix)
    return matrix


def to_pose(matrix: Array) -> Array:
    """Pose, shape (6,), of a homogeneous matrix, shape (4, 4)."""
    pose = np.empty(6)
    kernel.pose_of_place(_plain(matrix), pose)
    return pose


def _plain(array: Array) -> Array:
    """The array as the kernel takes it; for any other kind it would be compiled anew."""
    return np.ascontiguousarray(array, dtype=np.float64)


class Kinematics:
    """Forward and inverse kinematics and joint torques of one arm."""

    def __init__(self, geometry: ArmGeometry) -> None:
        self.geometry = geometry
        self._ca = [math.cos(alpha) for alpha in geometry.alpha]
        self._sa = [math.sin(alpha) for alpha in geometry.alpha]
        self.arm = np.column_stack(
            [
                geometry.a,
                geometry.d,
                self._ca,
                self._sa,
                np.array(geometry.mass) * _GRAVITY,
                geometry.centre,
                geometry.friction,
                geometry.inertia,
                geometry.torque_per_ampere,
            ]
        )
        """The arm as the kernel takes it, (6, 11)."""
        self.frames(np.zeros(6))  # compiled or loaded now, not in the first cycle

    def _link(self, joint: int, angle: float) -> Array:
        c, s = math.cos(angle), math.sin(angle)
        ca, sa = self._ca[joint], self._sa[joint]
        a, d = self.geometry.a[joint], self.geometry.d[joint]
        return np.array(
            [
                [c, -s * ca, s * sa, a * c],
                [s, c * ca, -c * sa, a * s],
                [0.0, sa, ca, d],
                [0.0, 0.0, 0.0, 1.0],
            ]
        )

    def frames(self, q: Array) -> Array:
        """Base, link 1 … link 6 (the flange) in the base frame, shape (7, 4, 4)."""
        result = np.empty((7, 4, 4))
        kernel.arm_frames(_plain(q), self.arm, result)
        return result

    def forward(self, q: Array) -> Array:
        """Flange matrix, shape (4, 4)."""
        flange: Array = self.frames(q)[6]
        return flange

    def jacobian(self, frames: Array, point: Array) -> Array:
        """Geometric Jacobian, shape (6, 6), of a point of the flange given in the base frame, shape
        (3,).
        """
        result = np.empty((6, 6))
        kernel.point_jacobian(_plain(frames), _plain(point), result)
        return result

    def track(self, flange: Array, q: Array, iterations: int = 3) -> Array:
        """Joint angles that put the flange at a matrix near where ``q`` puts it: damped Newton
        steps from ``q``.
        """
        q = np.array(q, dtype=np.float64)
        kernel.track(_plain(flange), q, self.arm, np.empty((7, 4, 4)), iterations)
        return q

    def in_reach(self, flange: Array) -> bool:
        """A quick necessary condition for a solution: the wrist is between the shoulder's offset
        and the stretched arm.
        """
        d, a = self.geometry.d, self.geometry.a
        x, y, z = (row[3] - d[5] * row[2] for row in flange[:3].tolist())
        radius = math.hypot(x, y)
        reach = math.hypot(radius, z - d[0])
        return abs(d[3]) < radius and reach < abs(a[1]) + abs(a[2]) + abs(d[3]) + abs(d[4])

    def solutions(self, flange: Array) -> list[Array]:
        """Every joint configuration (at most eight) that puts the flange at a matrix; empty if it
        is out of reach.
        """
        d4, d6 = self.geometry.d[3], self.geometry.d[5]
        a2, a3 = self.geometry.a[1], self.geometry.a[2]
        found: list[Array] = []
        wrist = flange[:3, 3] - d6 * flange[:3, 2]
        radius = math.hypot(wrist[0], wrist[1])
        if radius < abs(d4):
            return found
        inverse = flange[:3, :3].T
        for shoulder in (1.0, -1.0):
            q1 = math.atan2(wrist[1], wrist[0]) + shoulder * math.acos(d4 / radius) + math.pi / 2
            s1, c1 = math.sin(q1), math.cos(q1)
            cosine5 = (flange[0, 3] * s1 - flange[1, 3] * c1 - d4) / d6
            if abs(cosine5) > 1.0 + 1e-9:
                continue
            for flip in (1.0, -1.0):
                q5 = flip * math.acos(max(-1.0, min(1.0, cosine5)))
                s5 = math.sin(q5)
                q6 = 0.0
                if abs(s5) > 1e-9:  # else joints 2, 3, 4 and 6 are parallel and joint 6 is free
                    q6 = math.atan2(
                        (-inverse[1, 0] * s1 + inverse[1, 1] * c1) / s5,
                        (inverse[0, 0] * s1 - inverse[0, 1] * c1) / s5,
                    )
                outer = self._link(4, q5) @ self._link(5, q6)
                middle = np.linalg.solve(self._link(0, q1), flange) @ np.linalg.inv(outer)
                reach = middle[:3, 3] - d4 * middle[:3, 1]
                span = float(reach[0] ** 2 + reach[1] ** 2)
                cosine3 = (span - a2**2 - a3**2) / (2.0 * a2 * a3)
                if abs(cosine3) > 1.0:
                    continue
                for elbow in (1.0, -1.0):
                    q3 = elbow * math.acos(cosine3)
                    q2 = math.atan2(reach[1], reach[0]) - math.atan2(
                        a3 * math.sin(q3), a2 + a3 * math.cos(q3)
                    )
                    lower = np.linalg.solve(self._link(1, q2) @ self._link(2, q3), middle)
                    q4 = math.atan2(lower[1, 0], lower[0, 0])
                    found.append(np.array([_wrap(q) for q in (q1, q2, q3, q4, q5, q6)]))
        return found

    def inverse(self, flange: Array, near: Array) -> Array | None:
        """The configuration nearest to ``near``, with each joint within half a turn of it; None if
        out of reach.
        """
        candidates = [near + np.array([_wrap(a) for a in q - near]) for q in self.solutions(flange)]
        if not candidates:
            return None
        nearest: Array = min(candidates, key=lambda q: float(np.sum((q - near) ** 2)))
        return nearest

    def gravity_torque(self, frames: Array, payload: float, payload_centre: Array) -> Array:
        """Joint torques, shape (6,), N m, that hold links and payload (kg, centre in the flange
        frame) against gravity.
        """
        torque = np.empty(6)
        kernel.gravity(_plain(frames), self.arm, load_of(payload, payload_centre), torque)
        return torque


def load_of(payload: float, centre: Array) -> Array:
    """What the flange carries, kg, and its centre in the flange frame, (3,), m, as the kernel takes
    it: weight in N and centre, (4,).
    """
    return np.array([payload * _GRAVITY, *centre])


def _wrap(angle: float) -> float:
    """The same direction in (-pi, pi]."""
    wrapped = math.fmod(angle + math.pi, 2.0 * math.pi)
    return wrapped + math.pi if wrapped <= 0.0 else wrapped - math.pi
