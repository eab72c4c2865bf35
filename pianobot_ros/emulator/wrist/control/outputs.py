"""What the controller's output variables hold: the state of arm, program and safety."""

from __future__ import annotations

import enum
from typing import Any

from pianobot_ros.emulator.wrist.control.safety import RobotMode, Safety
from pianobot_ros.emulator.wrist.motion.mover import Motion

__all__ = ["CONSTANT", "RuntimeState", "output_values"]

CONSTANT: dict[str, Any] = {
    "joint_mode": [253] * 6,  # RUNNING
    "joint_temperatures": [31.0] * 6,
    "actual_joint_voltage": [48.0] * 6,
    "actual_main_voltage": 48.0,
    "actual_robot_voltage": 48.0,
    "actual_tool_accelerometer": [0.0, 0.0, -9.81],
}
"""Outputs that nothing changes."""


class RuntimeState(enum.IntEnum):
    """``runtime_state`` of the program."""

    STOPPED = 1
    PLAYING = 2
    PAUSED = 4


def output_values(
    time: float, motion: Motion, safety: Safety, runtime: RuntimeState, slider: float
) -> dict[str, Any]:
    """The outputs of one cycle, by the names of the RTDE guide; ``time`` is the controller's, s."""
    joints = motion.joints
    pose, twist, target, lag = motion.told().tolist()
    angles, speeds = joints.q.tolist(), joints.qd.tolist()
    current = joints.current.tolist()
    playing = runtime is RuntimeState.PLAYING
    powered = safety.robot is not RobotMode.POWER_OFF
    return {
        "timestamp": time,
        "actual_q": angles,
        "actual_qd": speeds,
        "target_q": [angle + behind for angle, behind in zip(angles, lag, strict=True)],
        "target_qd": speeds,
        "target_qdd": joints.qdd.tolist(),
        "actual_current": current if powered else [0.0] * 6,
        "target_current": current,
        "target_moment": joints.torque.tolist(),
        "actual_TCP_pose": pose,
        "actual_TCP_speed": twist,
        "actual_TCP_force": [*(-motion.force).tolist(), 0.0, 0.0, 0.0],
        "target_TCP_pose": target,
        "target_TCP_speed": twist,
        "tcp_offset": motion.tcp_offset,
        "payload": joints.payload,
        "payload_cog": joints.payload_centre.tolist(),
        "robot_mode": int(safety.robot),
        "safety_mode": int(safety.mode),
        "safety_status": int(safety.mode),
        "safety_status_bits": safety.bits,
        "runtime_state": int(runtime),
        "robot_status_bits": int(powered) | int(playing) << 1,
        "speed_scaling": 1.0 if safety.ready else 0.0,
        "target_speed_fraction": slider,
        "actual_momentum": 0.0,
        "actual_robot_current": sum(map(abs, current)),
    }
