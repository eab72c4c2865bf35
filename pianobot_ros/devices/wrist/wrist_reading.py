"""What goes to the arm and what comes from it."""

from __future__ import annotations

import enum
from typing import NamedTuple

from pianobot_ros.cell.motion.setpoints import WristSetpoint

__all__ = ["SafetyState", "Vector", "WristReading", "WristSetpoint"]

Vector = tuple[float, ...]


class SafetyState(enum.IntEnum):
    """Safety state of the arm, with the numbers of pianobot_msgs/WristState."""

    UNKNOWN = 0
    NORMAL = 1
    REDUCED = 2
    PROTECTIVE_STOP = 3
    RECOVERY = 4
    SAFEGUARD_STOP = 5
    EMERGENCY_STOP = 7
    FAULT = 9

    @classmethod
    def from_controller(cls, mode: int) -> SafetyState:
        """From the ``safety_mode`` of RTDE, which tells two kinds of emergency stop and of fault
        apart.
        """
        same = {6: cls.EMERGENCY_STOP, 8: cls.FAULT}
        try:
            return same.get(mode) or cls(mode)
        except ValueError:
            return cls.UNKNOWN

    @property
    def can_move(self) -> bool:
        """Whether the arm obeys in this state."""
        return self in (SafetyState.NORMAL, SafetyState.REDUCED)


class WristReading(NamedTuple):
    """One package of the controller, in plain numbers: most of it is only passed on.

    Attributes:
        sequence: number of the package since the driver's process started.
        time_ns: when it arrived, ns since the epoch.
        monotonic: when it arrived, s of the monotonic clock.
        controller_time: the controller's own clock, s.
        position, rotation: wrist pose in the base frame, m and rotation vector.
        twist: (6,), m/s and rad/s, base frame.
        target_position, target_rotation: the setpoint that the controller is following.
        q, qd: joint angles and speeds, (6,), rad and rad/s.
        currents: joint currents, (6,), A.
        safety: safety state.
        robot_mode: power state, number of RTDE; 7 is running.
        program_running: whether the controller's program executes commands.
        speed_scaling: 0 to 1, speed slider times safety scaling.
        servoing: whether the driver is streaming setpoints.
        applied: sequence number of the newest setpoint that was sent to the controller.
        latency: from ``write`` to this package for the newest setpoint that the controller echoed,
            s; NaN if not new.
        behind: by how much the arm was last given its path after the path's time, s: this machine
            held up the setpoints or the driver.
    """

    sequence: int
    time_ns: int
    monotonic: float
    controller_time: float
    position: Vector
    rotation: Vector
    twist: Vector
    target_position: Vector
    target_rotation: Vector
    q: Vector
    qd: Vector
    currents: Vector
    safety: SafetyState
    robot_mode: int
    program_running: bool
    speed_scaling: float
    servoing: bool
    applied: int
    latency: float
    behind: float
