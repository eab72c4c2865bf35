"""Reference trajectories of the controller's motion commands, in tool space or joint space.

Each has ``advance(dt)``, which moves the reference on by ``dt`` seconds, and ``finished``. Speeds
in m/s or rad/s.
"""

from __future__ import annotations

import math

import numpy as np

from pianobot_ros.emulator.wrist.motion.kinematics import Array, to_rotvec, transform

__all__ = ["JointMove", "JointSpeed", "LineMove", "ToolSpeed", "Trapezoid"]


class Trapezoid:
    """Travel along a path of given length from rest to rest, with a top speed and one acceleration
    both ways.
    """

    def __init__(self, length: float, speed: float, acceleration: float) -> None:
        self._length = length
        self._acceleration = max(acceleration, 1e-6)
        self._speed = max(min(speed, math.sqrt(length * self._acceleration)), 1e-9)
        self._ramp = self._speed / self._acceleration
        self.duration = length / self._speed + self._ramp if length > 0.0 else 0.0

    def travelled(self, time: float) -> float:
        """Share of the path covered after ``time`` seconds, 0 to 1."""
        if time >= self.duration:
            return 1.0
        rest = self.duration - time
        if time < self._ramp:
            way = 0.5 * self._acceleration * time**2
        elif rest < self._ramp:
            way = self._length - 0.5 * self._acceleration * rest**2
        else:
            way = self._speed * (time - 0.5 * self._ramp)
        return way / self._length


class _Move:
    """A move along a trapezoidal profile."""

    def __init__(self, profile: Trapezoid) -> None:
        self._profile = profile
        self._time = 0.0

    @property
    def finished(self) -> bool:
        """Whether the reference has arrived."""
        return self._time >= self._profile.duration


class LineMove(_Move):
    """``movel``: straight line of the tool, with the rotation spread evenly along it. Poses are
    matrices, (4, 4).
    """

    def __init__(self, start: Array, end: Array, speed: float, acceleration: float) -> None:
        self._start = start
        self._step = end[:3, 3] - start[:3, 3]
        self._turn = to_rotvec(end[:3, :3] @ start[:3, :3].T)
        length = float(np.linalg.norm(self._step))
        longest = max(length, float(np.linalg.norm(self._turn)) * 0.3)
        super().__init__(Trapezoid(longest, speed, acceleration))

    def advance(self, dt: float) -> Array:
        """The next tool pose."""
        self._time += dt
        share = self._profile.travelled(self._time)
        pose: Array = self._start.copy()
        pose[:3, 3] += share * self._step
        pose[:3, :3] = transform(share * self._turn) @ pose[:3, :3]
        return pose


class JointMove(_Move):
    """``movej``: all joints start and stop together, the leading one with the given speed and
    acceleration.
    """

    def __init__(self, start: Array, end: Array, speed: float, acceleration: float) -> None:
        self._start, self._step = start.copy(), end - start
        super().__init__(Trapezoid(float(np.max(np.abs(self._step))), speed, acceleration))

    def advance(self, dt: float) -> Array:
        """The next joint angles."""
        self._time += dt
        angles: Array = self._start + self._profile.travelled(self._time) * self._step
        return angles


class _Ramp:
    """A velocity that follows its target with a limited acceleration of its leading part."""

    def __init__(self, velocity: Array) -> None:
        self.velocity: Array = velocity.copy()
        self.target: Array = velocity.copy()
        self.acceleration = 1.0
        self.time_left = math.inf

    def toward(self, dt: float) -> Array:
        self.time_left -= dt
        change = self.target - self.velocity
        largest = float(np.max(np.abs(change)))
        step = self.acceleration * dt
        self.velocity = (
            self.target.copy() if largest <= step else self.velocity + change * (step / largest)
        )
        return self.velocity

    @property
    def finished(self) -> bool:
        """Whether the velocity is at its target and that is zero, or the commanded time is over."""
        at_rest = not self.target.any() and not self.velocity.any()
        return at_rest or self.time_left <= 0.0


class ToolSpeed(_Ramp):
    """``speedl`` and ``stopl``: tool velocity, (6,), in the base frame; integrates the tool pose,
    (4, 4).
    """

    def __init__(self, pose: Array, velocity: Array) -> None:
        super().__init__(velocity)
        self._pose: Array = pose.copy()

    def advance(self, dt: float) -> Array:
        """The next tool pose."""
        velocity = self.toward(dt)
        self._pose = self._pose.copy()
        self._pose[:3, 3] += velocity[:3] * dt
        self._pose[:3, :3] = transform(velocity[3:] * dt) @ self._pose[:3, :3]
        return self._pose


class JointSpeed(_Ramp):
    """``speedj`` and ``stopj``: joint velocities, (6,); integrates the joint angles."""

    def __init__(self, angles: Array, velocity: Array) -> None:
        super().__init__(velocity)
        self._angles: Array = angles.copy()

    def advance(self, dt: float) -> Array:
        """The next joint angles."""
        self._angles = self._angles + self.toward(dt) * dt
        return self._angles
