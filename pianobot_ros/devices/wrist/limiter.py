"""Guards the arm: every setpoint passes here before it is sent."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pianobot_ros.cell.motion.rotations import product, quaternion, rotation_vector
from pianobot_ros.devices.base import CommandRejectedError
from pianobot_ros.devices.wrist.config import LimitsConfig, WorkspaceConfig
from pianobot_ros.devices.wrist.wrist_reading import Array, WristSetpoint

__all__ = ["Limited", "SetpointLimiter"]

_SLACK = 0.05  # s of unused time that a late stream may catch up with
_TOLERANCE = 1.02  # rounding in the stream must not count as a violation


@dataclass(frozen=True)
class Limited:
    """A setpoint as it may be sent, and in words which limits changed it; empty if none did."""

    setpoint: WristSetpoint
    clamped: str


class SetpointLimiter:
    """Rejects setpoints that are not finite or leave the workspace, and clamps the step to what the
    limits allow.

    A stream that keeps the limits passes unchanged. One that breaks them is followed as fast as the
    limits allow, braking in time so that the setpoint is reached without overshoot.

    Args:
        limits: speed, acceleration and tilt.
        workspace: box for the wrist frame's origin.
        period: the controller's cycle, s.
    """

    def __init__(self, limits: LimitsConfig, workspace: WorkspaceConfig, period: float) -> None:
        self._limits = limits
        self._low, self._high = np.array(workspace.low), np.array(workspace.high)
        self._period = period
        self._sent: WristSetpoint | None = None  # last one passed on
        self._wanted: WristSetpoint | None = None  # last one asked for
        self._time = 0.0
        self._budget = 0.0

    def restart(self, position: Array, rotation: Array, now: float) -> None:
        """Begin anew from an arm at rest at this pose."""
        self._sent = WristSetpoint(position.copy(), rotation.copy(), np.zeros(6))
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
        if not all(np.isfinite(v).all() for v in values):
            raise CommandRejectedError(
                "wrist setpoint is not finite, or its quaternion not of length 1; nothing was sent"
            )
        outside = (setpoint.position < self._low) | (setpoint.position > self._high)
        if outside.any():
            axis = int(np.argmax(outside))
            raise CommandRejectedError(
                f"wrist setpoint is outside the workspace: {'xyz'[axis]} ="
                f" {setpoint.position[axis]:.4f} m, allowed {self._low[axis]:.3f} to"
                f" {self._high[axis]:.3f} m (workspace in wrist.yaml)"
            )
        tilt = math.hypot(*setpoint.rotation)
        if tilt > math.pi:
            tilt = math.hypot(*rotation_vector(quaternion(setpoint.rotation.tolist())))
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
        dt = self._step_time(setpoint, now)
        wanted = self._wanted
        if wanted is not None and wanted.stamp > 0.0 and setpoint.stamp > wanted.stamp:
            pace = setpoint.stamp - wanted.stamp
            drift = (setpoint.position - wanted.position) / pace
            spin = _turn(wanted.rotation, setpoint.rotation) / pace
        else:
            drift, spin = setpoint.velocity[:3], setpoint.velocity[3:]
        limits = self._limits
        velocity, why = _limited(
            setpoint.position - sent.position,
            sent.velocity[:3],
            drift,
            dt,
            top=limits.speed,
            acceleration=limits.acceleration,
        )
        rate, why_rotation = _limited(
            _turn(sent.rotation, setpoint.rotation),
            sent.velocity[3:],
            spin,
            dt,
            top=limits.angular_speed,
            acceleration=limits.angular_acceleration,
        )
        clamped = ", ".join(filter(None, [why, why_rotation and f"angular {why_rotation}"]))
        position = setpoint.position if not why else sent.position + velocity * dt
        rotation = setpoint.rotation
        if why_rotation:
            turned = product(quaternion((rate * dt).tolist()), quaternion(sent.rotation.tolist()))
            rotation = np.array(rotation_vector(turned))
        self._wanted = setpoint
        self._sent = WristSetpoint(
            position, rotation, np.concatenate([velocity, rate]), setpoint.stamp
        )
        return Limited(self._sent, clamped)

    def _step_time(self, setpoint: WristSetpoint, now: float) -> float:
        """Time that this step may take, s.

        The stream's own stamps give its pace, free of the jitter with which it arrives. Over more
        than a few cycles it may not run faster than real time, whatever the stamps say.
        """
        self._budget = min(self._budget + now - self._time, _SLACK)
        self._time = now
        wanted = self._wanted
        pace = (
            setpoint.stamp - wanted.stamp
            if wanted is not None and wanted.stamp > 0.0
            else self._period
        )
        if not 0.0 < pace <= _SLACK:
            pace = self._period
        dt = max(min(pace, self._budget + self._period), 0.1 * self._period)
        self._budget -= dt
        return dt


def _turn(start: Array, end: Array) -> Array:
    """Rotation vector that leads from one rotation vector to another."""
    if np.array_equal(start, end):  # most of the time
        return np.zeros(3)
    return np.array(
        rotation_vector(product(quaternion(end.tolist()), quaternion((-start).tolist())))
    )


def _limited(
    error: Array, velocity: Array, drift: Array, dt: float, *, top: float, acceleration: float
) -> tuple[Array, str]:
    """Velocity for the next step towards a target ``error`` away that moves with ``drift``, and
    which limit bent it.
    """
    wanted = error / dt
    step = acceleration * dt  # largest change of velocity in this step
    fast = float(np.linalg.norm(wanted)) > top * _TOLERANCE
    # Neither getting there nor, once there, going on with the target may take more than the step
    # allows.
    change = max(float(np.linalg.norm(wanted - velocity)), float(np.linalg.norm(wanted - drift)))
    hard = change > step * _TOLERANCE
    if not fast and not hard:
        return wanted, ""
    distance = float(np.linalg.norm(error))
    # Approach so that half of the acceleration is enough to brake; the other half is for following
    # the target. The speed
    # is held over the whole step, hence half a step's braking less than the square-root law of
    # continuous time.
    closing = min(
        math.sqrt((step / 2.0) ** 2 + acceleration * distance) - step / 2.0, distance / dt
    )
    wanted = drift + (error / distance * closing if distance > 0.0 else 0.0)
    wanted = _shortened(wanted, top)
    return velocity + _shortened(wanted - velocity, step), "speed" if fast else "acceleration"


def _shortened(vector: Array, length: float) -> Array:
    size = float(np.linalg.norm(vector))
    return vector if size <= length else vector * (length / size)
