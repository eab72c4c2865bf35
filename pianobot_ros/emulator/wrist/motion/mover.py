"""The moving arm: motion commands in, joint angles, tool pose and currents out, one controller
cycle at a time.

The wrist (the frame fixed to the hand) moves through the arm-servo model of the plant, which is
where injected wrist effects act. ``servoj`` hands its setpoint to that servo as it is. The other
commands follow a planned reference, which a real controller tracks within a millisecond; they are
sent through the same servo with its own dynamics inverted, so that the arm follows the plan while
the injected effects still act.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Protocol

import numpy as np
from scipy.linalg import expm

from pianobot_ros.emulator.wrist.motion import kernel
from pianobot_ros.emulator.wrist.motion.joints import Joints
from pianobot_ros.emulator.wrist.motion.kinematics import Array, from_pose, to_pose
from pianobot_ros.emulator.wrist.motion.trajectory import JointMove, JointSpeed, LineMove, ToolSpeed

__all__ = ["Arm", "Motion", "Mount", "ServoModel"]

_ARM_LENGTH = 0.3  # m, to compare a turn of the tool with its travel


class Arm(Protocol):
    """The arm-servo model of the plant."""

    def step(self, dt: float, target_pose: Array, force: Array) -> tuple[Array, Array]:
        """Move on by ``dt`` seconds; returns the wrist's true pose and twist, both (6,), base
        frame.
        """

    def measured(self) -> Array:
        """The wrist's pose, (6,), as the encoders give it."""


@dataclass(frozen=True)
class ServoModel:
    """The nominal servo: natural frequency, rad/s, and damping ratio."""

    frequency: float
    damping: float

    def propagator(self, dt: float) -> Array:
        """Matrix, (2, 2), that carries offset from a held target, and its rate, over ``dt``
        seconds.
        """
        return _propagator(self.frequency, self.damping, dt)

    def input_for(self, reference: Array, rate: Array, acceleration: Array) -> Array:
        """Input, (6,), with which the servo follows a reference and its derivatives, (6,) each."""
        w, z = self.frequency, self.damping
        result: Array = reference + (2.0 * z / w) * rate + acceleration / w**2
        return result


@lru_cache(maxsize=8)
def _propagator(frequency: float, damping: float, dt: float) -> Array:
    rate = np.array([[0.0, 1.0], [-(frequency**2), -2.0 * damping * frequency]])
    return np.asarray(expm(rate * dt), dtype=np.float64)


@dataclass(frozen=True)
class Mount:
    """How the hand sits on the flange.

    Attributes:
        rotation: the flange's axes in the wrist frame, as a matrix (3, 3): R_flange = R_wrist @
            rotation.
        offset: the wrist frame's origin in the flange frame, (3,), m.
    """

    rotation: Array
    offset: Array

    @cached_property
    def matrix(self) -> Array:
        """Both, (4, 4), as the kernel takes them."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.rotation, self.offset
        return matrix

    def flange(self, wrist: Array) -> Array:
        """Flange matrix, (4, 4), of a wrist pose, (6,)."""
        flange = np.empty((4, 4))
        kernel.flange_of_wrist(wrist, self.matrix, flange)
        return flange

    def wrist(self, flange: Array) -> Array:
        """Wrist pose, (6,), of a flange matrix, (4, 4)."""
        wrist = np.empty(6)
        kernel.wrist_of_flange(flange, self.matrix, wrist)
        return wrist


_Path = LineMove | JointMove | ToolSpeed | JointSpeed


@dataclass
class Motion:
    """State of the arm.

    Attributes:
        joints: its joints, which follow from ``measured``.
        pose, twist: true ones of the wrist, (6,), base frame.
        measured: the wrist's pose as the encoders give it; the tool pose follows from it.
        flange: flange matrix, (4, 4).
        tcp: tool centre point in the flange frame, (4, 4), as set by the program.
        force: what the keys push on the wrist, (3,), N, base frame.
        mode: ``hold``, ``servo``, or the name of the running motion command.
    """

    arm: Arm
    servo: ServoModel
    joints: Joints
    mount: Mount
    tcp_pose: Array = field(default_factory=lambda: np.zeros(6))

    def __post_init__(self) -> None:
        self.set_tcp(self.tcp_pose)
        self.kinematics = self.joints.kinematics
        self.flange = self.kinematics.forward(self.joints.q)
        self.pose = self.mount.wrist(self.flange)
        self.measured = self.pose
        self.twist = np.zeros(6)
        self.force = np.zeros(3)
        self.mode = "hold"
        self._path: _Path | None = None
        self._deceleration = 0.0
        # what the servo was last told, without the inverse dynamics
        self._target = self.pose.copy()
        self._reference_twist = np.zeros(6)
        self.rest_time = 0.0
        self.joints.bear(self.pose[:3], self.force)

    # What a program can ask for. Tool poses are (6,) in the base frame.

    def set_tcp(self, pose: Array) -> None:
        """``set_tcp``: the tool centre point as a pose, (6,), in the flange frame."""
        self.tcp = from_pose(pose)
        self.tcp_offset = to_pose(self.tcp).tolist()
        self._tcp_inverse = np.linalg.inv(self.tcp)

    @property
    def tool(self) -> Array:
        """Tool matrix, (4, 4)."""
        return self.flange @ self.tcp

    def told(self) -> Array:
        """What the controller tells of the tool, (4, 6): its pose, its twist in the base frame, the
        pose that it is following, and how far the joints are behind, rad, to first order.
        """
        wrist = np.array([self.pose, self.twist, self._target])
        out = np.empty((4, 6))
        kernel.told(self.flange, self.tcp, self.mount.matrix, self.joints.jacobian, wrist, out)
        if self.mode == "hold":
            out[3] = 0.0
        return out

    def flange_of(self, tool_pose: Array) -> Array:
        """Flange matrix, (4, 4), for a tool pose."""
        flange = np.empty((4, 4))
        kernel.flange_of_tool(tool_pose, self._tcp_inverse, flange)
        return flange

    def servo_to(self, flange: Array) -> None:
        """``servoj`` towards a flange matrix, (4, 4), from this cycle on."""
        self._target = self.mount.wrist(flange)
        self._path, self.mode = None, "servo"

    def move_line(self, tool_pose: Array, speed: float, acceleration: float) -> None:
        """Start ``movel``."""
        self._begin("movel", LineMove(self.tool, from_pose(tool_pose), speed, acceleration))

    def move_joints(self, q: Array, speed: float, acceleration: float) -> None:
        """Start ``movej``."""
        self._begin("movej", JointMove(self.joints.q, q, speed, acceleration))

    def speed_tool(self, velocity: Array, acceleration: float, time: float) -> None:
        """Start or update ``speedl``; ``time`` 0 means until further notice."""
        if not isinstance(self._path, ToolSpeed) or self.mode != "speedl":
            self._begin("speedl", ToolSpeed(self.tool, self.told()[1]))
        self._set_speed(velocity, acceleration, time)

    def speed_joints(self, velocity: Array, acceleration: float, time: float) -> None:
        """Start or update ``speedj``; ``time`` 0 means until further notice."""
        if not isinstance(self._path, JointSpeed) or self.mode != "speedj":
            self._begin("speedj", JointSpeed(self.joints.q, self.joints.qd))
        self._set_speed(velocity, acceleration, time)

    def stop_tool(self, deceleration: float) -> None:
        """Start ``stopl``: brake along the present direction, from the present velocity."""
        self._brake("stopl", deceleration)

    def stop_joints(self, deceleration: float) -> None:
        """Start ``stopj``."""
        self._brake("stopj", deceleration)

    @property
    def busy(self) -> bool:
        """Whether a motion that ends by itself is still running."""
        return self.mode in ("movel", "movej", "stopl", "stopj")

    @property
    def steady(self) -> bool:
        """Whether the arm has been at rest for a while (``is_steady``)."""
        return self.rest_time > 0.1

    # One controller cycle.

    def step(self, dt: float, force: Array, scaling: float = 1.0) -> str | None:
        """Move on by one cycle.

        Args:
            dt: cycle time, s.
            force: what the keys push on the wrist, (3,), N, base frame.
            scaling: speed slider, 0 to 1; slows planned motions, not ``servoj``.

        Returns:
            Why the safety system must stop the arm, or None.
        """
        if self.mode in ("stopl", "stopj"):
            target = self._braking(dt)
        else:
            target = self._target if self._path is None else self._follow(self._path, dt, scaling)
        self.pose, self.twist = self.arm.step(dt, target, force)
        if self.mode in ("stopl", "stopj"):
            self._target = self.pose.copy()
            self.mode = "hold" if self._deceleration == 0.0 else self.mode
        self.force = force
        self.measured = self.arm.measured()
        wrist = np.empty((4, 6))
        wrist[0], wrist[1], wrist[2], wrist[3, :3] = self.measured, self.twist, self.pose, force
        self.flange = self.joints.carry(dt, wrist, self.mount.matrix)
        at_rest = max(map(abs, self.twist.tolist())) < 1e-3
        self.rest_time = self.rest_time + dt if at_rest else 0.0
        return self.joints.fault(self.flange)

    def _begin(self, mode: str, path: _Path | None) -> None:
        self._path, self.mode = path, mode
        self._target = self.pose.copy()
        self._reference_twist = self.twist.copy()

    def _brake(self, mode: str, deceleration: float) -> None:
        self._begin(mode, None)
        self._deceleration = max(deceleration, 0.1)

    def _braking(self, dt: float) -> Array:
        """The servo's input that takes the deceleration times ``dt`` off the speed within this
        cycle.
        """
        if self.mode == "stopj":
            speed = float(np.max(np.abs(self.joints.qd)))
        else:
            speed = max(
                float(np.linalg.norm(self.twist[:3])),
                _ARM_LENGTH * float(np.linalg.norm(self.twist[3:])),
            )
        left = max(0.0, 1.0 - self._deceleration * dt / speed) if speed > 0.0 else 0.0
        if left == 0.0:
            self._deceleration = 0.0  # at rest after this cycle
        a = self.servo.propagator(dt)
        target: Array = self.pose - (left - a[1, 1]) * self.twist / a[1, 0]
        return target

    def _set_speed(self, velocity: Array, acceleration: float, time: float) -> None:
        path = self._path
        assert isinstance(path, ToolSpeed | JointSpeed)
        path.target = np.asarray(velocity, dtype=float).copy()
        path.acceleration = max(acceleration, 1e-3)
        path.time_left = time if time > 0.0 else np.inf

    def _follow(self, path: _Path, dt: float, scaling: float) -> Array:
        """The servo's input that makes a nominal arm follow the reference: its dynamics
        inverted.
        """
        point = path.advance(dt * scaling)
        flange = (
            self.kinematics.forward(point) if point.shape == (6,) else point @ self._tcp_inverse
        )
        reference = self.mount.wrist(flange)
        twist = (reference - self._target) / dt
        acceleration = (twist - self._reference_twist) / dt
        self._target, self._reference_twist = reference, twist
        if path.finished:
            self._path = None
            self.mode = "hold"
            self._reference_twist = np.zeros(6)
            return reference
        return self.servo.input_for(reference, twist, acceleration)
