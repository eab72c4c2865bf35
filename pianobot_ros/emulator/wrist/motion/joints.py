"""The arm's joints: angles that follow the flange, what drives them, and what they cannot do."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pianobot_ros.emulator.wrist.motion.kinematics import Array, Kinematics

__all__ = ["JOINT_LIMIT", "Joints"]

JOINT_LIMIT = 2.0 * np.pi * 363.0 / 360.0
"""UR5 user manual: working range of every joint +-360 degrees; the safety system stops at +-363
degrees.
"""

JOINT_SPEED_LIMIT = np.radians(191.0)
"""UR5 user manual: default safety limit of the joint speed."""


@dataclass
class Joints:
    """State of the joints.

    Attributes:
        q, qd, qdd: joint angles and their derivatives, (6,).
        payload, payload_centre: what the flange carries, kg, and where in its frame, (3,), m.
        torque: static joint torques, (6,), N m: gravity, and the force of the keys on the wrist.
        current: motor currents, (6,), A.
    """

    kinematics: Kinematics
    q: Array
    payload: float = 0.0
    payload_centre: Array = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        self.qd = np.zeros(6)
        self.qdd = np.zeros(6)
        self._frames = self.kinematics.frames(self.q)

    def bear(self, point: Array, force: Array) -> None:
        """Renew torques and currents: ``force`` (3,), N, acts on ``point`` (3,), both in the base
        frame.
        """
        self._jacobian = self.kinematics.jacobian(self._frames, point)
        gravity = self.kinematics.gravity_torque(self._frames, self.payload, self.payload_centre)
        self.torque: Array = gravity - self._jacobian[:3].T @ force
        self.current = self.kinematics.currents(self.torque, self.qd, self.qdd)

    def turn(self, twist: Array) -> Array:
        """Joint changes, (6,), that move the point borne by ``twist`` (6,), base frame."""
        return np.asarray(
            np.linalg.solve(self._jacobian + 1e-9 * np.eye(6), twist), dtype=np.float64
        )

    def follow(self, dt: float, flange: Array, twist: Array) -> None:
        """Move on by ``dt`` s to where the flange, (4, 4), is; ``twist`` as in :meth:`turn`."""
        q = self.kinematics.track(flange, self.q + self.qd * dt)
        # From the twist, as differences of the angles would be mostly encoder noise.
        qd = self.turn(twist)
        # the difference alone is too rough to drive a current
        self.qdd += 0.2 * ((qd - self.qd) / dt - self.qdd)
        self.q, self.qd = q, qd
        self._frames = self.kinematics.frames(q)

    def fault(self, flange: Array) -> str | None:
        """Why the safety system must stop the arm whose flange, (4, 4), is there, or None."""
        speed, angle = np.abs(self.qd), np.abs(self.q)
        if float(np.max(speed)) > JOINT_SPEED_LIMIT:
            return f"joint {int(np.argmax(speed))} is faster than {JOINT_SPEED_LIMIT:.2f} rad/s"
        if float(np.max(angle)) > JOINT_LIMIT:
            return f"joint {int(np.argmax(angle))} is beyond its range"
        if float(np.max(np.abs(self._frames[6, :3, 3] - flange[:3, 3]))) > 1e-3:
            return "the joints cannot follow: singular, or out of reach"
        return None
