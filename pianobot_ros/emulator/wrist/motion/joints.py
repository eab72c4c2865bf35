"""The arm's joints: angles that follow the flange, what drives them, and what they cannot do."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pianobot_ros.emulator.wrist.motion import kernel
from pianobot_ros.emulator.wrist.motion.kinematics import Array, Kinematics, load_of

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
        # What the kernel changes in place; all others see its rows.
        self._state = np.zeros((5, 6))
        self._state[kernel.Q] = self.q
        self.q, self.qd, self.qdd, self.torque, self.current = self._state
        self._frames = self.kinematics.frames(self.q)
        self.jacobian: Array = np.zeros((6, 6))

    def bear(self, point: Array, force: Array) -> None:
        """Renew torques and currents: ``force`` (3,), N, acts on ``point`` (3,), both in the base
        frame.
        """
        arm, load = self.kinematics.arm, load_of(self.payload, self.payload_centre)
        kernel.bear(self._state, arm, self._frames, self.jacobian, load, point, force)

    def carry(self, dt: float, wrist: Array, mount: Array) -> Array:
        """Move on by ``dt`` s to where the wrist is, and :meth:`bear` its force there. ``wrist``
        (4, 6) is its pose as measured, its twist, its true pose, and first in the last row the
        force; ``mount`` (4, 4) its place on the flange. Returns the flange, (4, 4).
        """
        load = load_of(self.payload, self.payload_centre)
        flange: Array = kernel.carry(
            self._state,
            self.kinematics.arm,
            self._frames,
            self.jacobian,
            load,
            mount,
            wrist,
            dt,
        )
        return flange

    def fault(self, flange: Array) -> str | None:
        """Why the safety system must stop the arm whose flange, (4, 4), is there, or None."""
        speed = [abs(x) for x in self.qd.tolist()]
        if (fastest := max(speed)) > JOINT_SPEED_LIMIT:
            joint = speed.index(fastest)
            return f"joint {joint} is faster than {JOINT_SPEED_LIMIT:.2f} rad/s"
        angle = [abs(x) for x in self.q.tolist()]
        if (farthest := max(angle)) > JOINT_LIMIT:
            return f"joint {angle.index(farthest)} is beyond its range"
        reached, wanted = self._frames[6, :3, 3].tolist(), flange[:3, 3].tolist()
        if max(abs(a - b) for a, b in zip(reached, wanted, strict=True)) > 1e-3:
            return "the joints cannot follow: singular, or out of reach"
        return None
