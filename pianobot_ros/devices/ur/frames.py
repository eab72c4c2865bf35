"""Between the wrist frame, which the cell speaks of, and the tool pose, which the controller speaks of.

The tool centre point is set to the wrist frame's origin, so positions agree. The tool's axes are those of the flange:
R_tool = R_wrist @ R_mount with the fixed mount rotation of ``wrist.yaml``.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from pianobot_ros.devices.ur.config import MountConfig
from pianobot_ros.devices.ur.types import Array

__all__ = ["MountFrames"]


class MountFrames:
    """Converts poses with one mount."""

    def __init__(self, mount: MountConfig) -> None:
        self._mount = Rotation.from_rotvec(mount.rotation)
        self._inverse = self._mount.inv()
        self._last: tuple[Array, Array] | None = None

    def tool(self, position: Array, rotation: Array) -> Array:
        """Tool pose, (6,), of a wrist position, (3,), and rotation vector, (3,)."""
        if self._last is None or not np.array_equal(rotation, self._last[0]):  # a stream often keeps its rotation
            self._last = rotation.copy(), (Rotation.from_rotvec(rotation) * self._mount).as_rotvec()
        return np.concatenate([position, self._last[1]])

    def wrist(self, tool: Array) -> tuple[Array, Array]:
        """Wrist position and rotation vector of a tool pose."""
        return tool[:3], (Rotation.from_rotvec(tool[3:]) * self._inverse).as_rotvec()
