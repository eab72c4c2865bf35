"""Between the wrist frame, which the cell speaks of, and the tool pose, which the controller speaks of.

The tool centre point is set to the wrist frame's origin, so positions agree. The tool's axes are those of the flange:
R_tool = R_wrist @ R_mount with the fixed mount rotation of ``wrist.yaml``.
"""

from __future__ import annotations

import numpy as np

from pianobot_ros.devices.ur.config import MountConfig
from pianobot_ros.devices.ur.rotations import product, quaternion, rotation_vector
from pianobot_ros.devices.ur.types import Array

__all__ = ["MountFrames"]


class MountFrames:
    """Converts poses with one mount."""

    def __init__(self, mount: MountConfig) -> None:
        self._mount = quaternion(mount.rotation)
        self._inverse = quaternion([-c for c in mount.rotation])

    def tool(self, position: Array, rotation: Array) -> Array:
        """Tool pose, (6,), of a wrist position, (3,), and rotation vector, (3,)."""
        turned = rotation_vector(product(quaternion(rotation.tolist()), self._mount))
        return np.array([*position.tolist(), *turned])

    def wrist(self, tool: Array) -> tuple[Array, Array]:
        """Wrist position and rotation vector of a tool pose."""
        return tool[:3], np.array(rotation_vector(product(quaternion(tool[3:].tolist()), self._inverse)))
