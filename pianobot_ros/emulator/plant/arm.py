"""The arm's servo: from target pose to wrist pose."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pianobot_ros.cell.config import Section, load_section, quantity
from pianobot_ros.emulator.bus import PlantBus
from pianobot_ros.emulator.plant.case import Case

__all__ = ["ArmModel", "Servo"]

Array = NDArray[np.float64]


class Servo(Section):
    """The nominal servo (``config/arm.yaml``)."""

    natural_frequency: float = quantity("rad/s", low=1)
    damping_ratio: float = quantity("1", low=0.05)


class ArmModel:
    """The wrist frame as the servo moves it; made once, stepped at the controller's rate.

    Each coordinate of the pose (position m, rotation vector rad, base frame) follows its target as a second-order system,
    solved exactly for a target that is held over the step.
    """

    def __init__(self, pose: ArrayLike, case: Case | None = None) -> None:
        self.case = case or Case()
        self.servo = load_section("arm.yaml", Servo, "servo")
        self._time = 0.0
        self.reset(pose)

    @classmethod
    def from_bus(cls, pose: ArrayLike, bus: PlantBus) -> ArmModel:
        """The arm of the cell behind ``bus``, with the effects that its case gives the arm."""
        return cls(pose, Case.from_json(bus.case()))

    def reset(self, pose: ArrayLike) -> None:
        """At rest at ``pose`` (6,)."""
        self.pose: Array = np.array(pose, dtype=float)
        self.twist: Array = np.zeros(6)

    def step(self, dt: float, target_pose: ArrayLike, force: ArrayLike = (0.0, 0.0, 0.0)) -> tuple[Array, Array]:
        """Advance by ``dt`` s with ``target_pose`` (6,) held; ``force`` (3,) N is what the keys exert on the wrist.

        Returns copies of pose (6,) and its time derivative (6,) at the end of the step.
        """
        del force
        target = np.asarray(target_pose, dtype=float)
        a, b = self._propagator(dt)
        offset = self.pose - target
        self.pose = target + a[0, 0] * offset + a[0, 1] * self.twist
        self.twist = a[1, 0] * offset + a[1, 1] * self.twist
        del b
        self._time += dt
        return self.pose.copy(), self.twist.copy()

    def _propagator(self, dt: float) -> tuple[Array, None]:
        from scipy.linalg import expm

        w, z = self.servo.natural_frequency, self.servo.damping_ratio
        return np.asarray(expm(np.array([[0.0, 1.0], [-w * w, -2 * z * w]]) * dt)), None
