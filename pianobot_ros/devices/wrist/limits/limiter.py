"""Guards the arm: every setpoint passes here before it is sent. In plain numbers, as small arrays
would take most of the time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.motion.rotations import quaternion, rotation_vector
from pianobot_ros.devices.base import CommandRejectedError
from pianobot_ros.devices.wrist.config import LimitsConfig, WorkspaceConfig
from pianobot_ros.devices.wrist.limits.approach import (
    TOLERANCE,
    Vector,
    bent,
    braking,
    difference,
    moved,
    shortened,
    turn,
    turned,
)
from pianobot_ros.devices.wrist.wrist_reading import WristSetpoint

__all__ = ["Limited", "SetpointLimiter"]

_SLACK = 0.05  # s of unused time that a late stream may catch up with


class _Step(NamedTuple):
    """A setpoint that was asked for or passed on: position m, rotation vector rad, their rates
    m/s and rad/s, and stamp s.
    """

    position: Vector
    rotation: Vector
    velocity: Vector
    rate: Vector
    stamp: float


_REST = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Limited:
    """A setpoint as it may be sent, and in words which limits changed it; empty if none did."""

    setpoint: WristSetpoint
    clamped: str


class SetpointLimiter:
    """Rejects setpoints that are not finite or leave the workspace, and clamps the step to what the
    limits allow.

    A stream that keeps the limits passes unchanged. One that breaks them is followed as fast as the
    limits allow, braking in time so that the setpoint is reached without overshoot. Whatever is
    asked for, and however fast it says that it moves, what is passed on stays in the workspace and
    below the tilt.

    Args:
        limits: speed, acceleration and tilt.
        workspace: box for the wrist frame's origin.
        period: the controller's cycle, s.
    """

    def __init__(self, limits: LimitsConfig, workspace: WorkspaceConfig, period: float) -> None:
        self._limits = limits
        self._box = tuple(zip("xyz", workspace.low, workspace.high, strict=True))
        self._period = period
        self._sent: _Step | None = None  # last one passed on
        self._wanted: _Step | None = None  # last one asked for
        self._time = 0.0
        self._budget = 0.0

    def restart(self, position: Array, rotation: Array, now: float) -> None:
        """Begin anew from an arm at rest at this pose."""
        self._sent = _Step(position.tolist(), rotation.tolist(), _REST, _REST, 0.0)
        self._wanted = None
        self._time = now
        self._budget = 0.0

    @property
    def started(self) -> bool:
        """Whether :meth:`restart` was ever called."""
        return self._sent is not None

    def check(self, setpoint: WristSetpoint) -> None:
        """Raise CommandRejectedError if the setpoint must not be followed at all."""
        values = (setpoint.position, setpoint.rotation, setpoint.velocity)
        if [v.shape for v in values] != [(3,), (3,), (6,)]:
            raise CommandRejectedError(
                f"wrist setpoint has shapes {[v.shape for v in values]}, not (3,), (3,), (6,)"
            )
        position, rotation, velocity = (v.tolist() for v in values)
        if not all(map(math.isfinite, (*position, *rotation, *velocity))):
            raise CommandRejectedError(
                "wrist setpoint is not finite, or its quaternion not of length 1; nothing was sent"
            )
        for place, (axis, low, high) in zip(position, self._box, strict=True):
            if not low <= place <= high:
                raise CommandRejectedError(
                    f"wrist setpoint is outside the workspace: {axis} = {place:.4f} m, allowed"
                    f" {low:.3f} to {high:.3f} m (workspace in wrist.yaml)"
                )
        tilt = math.hypot(*rotation)
        if tilt > math.pi:
            tilt = math.hypot(*rotation_vector(quaternion(rotation)))
        if tilt > self._limits.tilt:
            raise CommandRejectedError(
                f"wrist setpoint is tilted by {tilt:.2f} rad from the playing pose, allowed"
                f" {self._limits.tilt:.2f} rad (limits.tilt in wrist.yaml)"
            )

    def limit(self, setpoint: WristSetpoint, now: float) -> Limited:
        """The nearest setpoint that may be sent at monotonic time ``now``, s.

        Raises:
            CommandRejectedError: as :meth:`check`.
        """
        self.check(setpoint)
        sent = self._sent
        assert sent is not None, "restart() comes first"
        given = setpoint.velocity.tolist()
        asked = _Step(
            setpoint.position.tolist(),
            setpoint.rotation.tolist(),
            given[:3],
            given[3:],
            setpoint.stamp,
        )
        dt = self._step_time(asked.stamp, now)
        limits = self._limits
        drift, spin = self._followable(asked)
        (velocity, why), (rate, why_rotation) = bent(
            limits,
            (difference(asked.position, sent.position), turn(sent.rotation, asked.rotation)),
            (sent.velocity, sent.rate),
            (drift, spin),
            dt,
        )
        clamped = ", ".join(filter(None, [why, why_rotation and f"angular {why_rotation}"]))
        position, rotation = asked.position, asked.rotation
        if why:
            position = self._inside(sent.position, moved(sent.position, velocity, dt))
            velocity = [d / dt for d in difference(position, sent.position)]
        if why_rotation:
            most = max(limits.tilt, math.hypot(*sent.rotation))
            rotation = shortened(turned(sent.rotation, rate, dt), most)
            rate = [w / dt for w in turn(sent.rotation, rotation)]
        self._wanted = asked
        self._sent = _Step(position, rotation, velocity, rate, asked.stamp)
        passed = WristSetpoint(
            np.array(position), np.array(rotation), np.array([*velocity, *rate]), asked.stamp
        )
        return Limited(passed, clamped)

    def _pace(self, asked: _Step) -> tuple[Vector, Vector]:
        """Velocity and rate of the motion that is asked for: what its stamps say, else what it says
        itself, if its poses move so.
        """
        wanted = self._wanted
        if wanted is None:
            return asked.velocity, asked.rate
        stamped = 0.0 < wanted.stamp < asked.stamp
        pace = asked.stamp - wanted.stamp if stamped else self._period
        drift = [d / pace for d in difference(asked.position, wanted.position)]
        spin = [d / pace for d in turn(wanted.rotation, asked.rotation)]
        if stamped:
            return drift, spin
        return (
            shortened(asked.velocity, math.hypot(*drift)),
            shortened(asked.rate, math.hypot(*spin)),
        )

    def _followable(self, asked: _Step) -> tuple[Vector, Vector]:
        """The pace that is asked for as far as the arm may go on with it: not at all where it
        breaks the limits (streams that fight say such), and towards a wall no faster than it can
        brake before it.
        """
        limits = self._limits
        drift, spin = self._pace(asked)
        if math.hypot(*drift) > limits.speed * TOLERANCE:
            drift = _REST
        if math.hypot(*spin) > limits.angular_speed * TOLERANCE:
            spin = _REST
        drift = [
            min(
                max(d, -braking(limits.acceleration, p - low)),
                braking(limits.acceleration, high - p),
            )
            for d, p, (_, low, high) in zip(drift, asked.position, self._box, strict=True)
        ]
        room = limits.tilt - math.hypot(*asked.rotation)
        return drift, shortened(spin, braking(limits.angular_acceleration, room))

    def _inside(self, start: Vector, end: Vector) -> Vector:
        """The end of a step, in the workspace; from outside of it no further out."""
        return [
            min(max(e, min(low, s)), max(high, s))
            for s, e, (_, low, high) in zip(start, end, self._box, strict=True)
        ]

    def _step_time(self, stamp: float, now: float) -> float:
        """Time that the step to a setpoint with this ``stamp`` may take, s.

        The stream's own stamps give its pace, free of the jitter with which it arrives. Over more
        than a few cycles it may not run faster than real time, whatever the stamps say.
        """
        self._budget = min(self._budget + now - self._time, _SLACK)
        self._time = now
        wanted = self._wanted
        pace = stamp - wanted.stamp if wanted is not None and wanted.stamp > 0.0 else self._period
        if not 0.0 < pace <= _SLACK:
            pace = self._period
        dt = max(min(pace, self._budget + self._period), 0.1 * self._period)
        self._budget -= dt
        return dt
