"""Between the wrist frame, which the cell speaks of, and the tool pose, which the controller speaks
of.

The tool centre point is set to the wrist frame's origin, so positions agree. The tool's axes are
those of the flange: R_tool = R_wrist @ R_mount with the fixed mount rotation of ``wrist.yaml``.
"""

from __future__ import annotations

from collections.abc import Sequence

from pianobot_ros.cell.motion.rotations import product, quaternion, rotation_vector
from pianobot_ros.devices.wrist.config import MountConfig
from pianobot_ros.devices.wrist.messages import RawReading
from pianobot_ros.devices.wrist.wrist_reading import SafetyState, Vector, WristReading

__all__ = ["MountFrames"]


class MountFrames:
    """Converts poses with one mount."""

    def __init__(self, mount: MountConfig) -> None:
        self._mount = quaternion(mount.rotation)
        self._inverse = quaternion([-c for c in mount.rotation])

    def tool(self, position: Sequence[float], rotation: Sequence[float]) -> Vector:
        """Tool pose, (6,), of a wrist position, (3,), and rotation vector, (3,)."""
        return *position, *rotation_vector(product(quaternion(rotation), self._mount))

    def wrist(self, tool: Vector) -> tuple[Vector, Vector]:
        """Wrist position and rotation vector of a tool pose."""
        return tool[:3], rotation_vector(product(quaternion(tool[3:]), self._inverse))

    def reading(self, raw: RawReading) -> WristReading:
        """A package of the controller, with its poses as the cell speaks of them."""
        position, rotation = self.wrist(raw.pose)
        target_position, target_rotation = self.wrist(raw.target)
        return WristReading(
            sequence=raw.sequence,
            time_ns=raw.time_ns,
            monotonic=raw.monotonic,
            controller_time=raw.controller_time,
            position=position,
            rotation=rotation,
            twist=raw.speed,
            target_position=target_position,
            target_rotation=target_rotation,
            q=raw.q,
            qd=raw.qd,
            currents=raw.current,
            safety=SafetyState.from_controller(raw.safety_mode),
            robot_mode=raw.robot_mode,
            program_running=raw.program_running,
            speed_scaling=raw.speed_scaling,
            servoing=raw.servoing,
            applied=raw.applied,
            latency=raw.latency,
            behind=raw.behind,
        )
