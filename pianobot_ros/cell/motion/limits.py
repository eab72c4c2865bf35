"""What the wrist may do: the limits of ``config/wrist.yaml`` that planning has to keep."""

from __future__ import annotations

import math
from functools import lru_cache

from pydantic import model_validator

from pianobot_ros.cell.motion.wrist_poses import WristPose
from pianobot_ros.cell.numbers.config import Section, load_section, quantity

__all__ = ["LimitsConfig", "MountConfig", "WorkspaceConfig", "WristLimits", "wrist_limits"]


class MountConfig(Section):
    """How the hand sits on the flange."""

    rotation: tuple[float, float, float] = quantity("rad")
    tcp_offset: tuple[float, float, float] = quantity("m")
    home: tuple[float, float, float] = quantity("m")
    payload: float = quantity("kg", low=0, high=5)
    payload_centre: tuple[float, float, float] = quantity("m")


class LimitsConfig(Section):
    """What the wrist may do."""

    speed: float = quantity("m/s", low=0.01, high=3)
    acceleration: float = quantity("m/s^2", low=0.1, high=100)
    angular_speed: float = quantity("rad/s", low=0.01, high=3.2)
    angular_acceleration: float = quantity("rad/s^2", low=0.1, high=100)
    tilt: float = quantity("rad", low=0.01, high=3.1)
    stale: float = quantity("s", low=0.008, high=0.04)


class WorkspaceConfig(Section):
    """Box of the wrist frame's origin in the base frame."""

    low: tuple[float, float, float] = quantity("m")
    high: tuple[float, float, float] = quantity("m")

    @model_validator(mode="after")
    def _ordered(self) -> WorkspaceConfig:
        if any(a >= b for a, b in zip(self.low, self.high, strict=True)):
            raise ValueError(f"low {self.low} must be below high {self.high} on every axis")
        return self


class WristLimits(LimitsConfig, WorkspaceConfig):
    """Limits of motion and the box that the wrist frame must stay in; ``home`` (3,) m in the base
    frame.
    """

    home: tuple[float, float, float]

    def fastest(self, amplitude: float) -> float:
        """Highest peak speed (m/s) of a strike over an ``amplitude`` (m): a half cosine of peak
        speed v and travel A needs 2 v^2 / A.
        """
        return min(self.speed, math.sqrt(self.acceleration * amplitude / 2.0))

    def refusal(self, pose: WristPose) -> str:
        """Why the pose is not allowed, or an empty string."""
        for axis, value, low, high in zip("xyz", pose.position, self.low, self.high, strict=True):
            if not low <= value <= high:
                return (
                    f"the wrist would be at {axis} = {value:.3f} m, outside the workspace {low:g}"
                    f" to {high:g} m"
                )
        tilt = float(pose.rotation.magnitude())
        return (
            f"the wrist would tilt by {tilt:.2f} rad, allowed are {self.tilt:g}"
            if tilt > self.tilt
            else ""
        )


@lru_cache(maxsize=8)
def wrist_limits(path: str = "wrist.yaml") -> WristLimits:
    """The limits of the configuration in force. Raises ConfigError."""
    limits = load_section(path, LimitsConfig, "limits")
    workspace = load_section(path, WorkspaceConfig, "workspace")
    home = load_section(path, MountConfig, "mount").home
    return WristLimits(**dict(limits), **dict(workspace), home=home)
