"""What the wrist may do: the limits of ``config/wrist.yaml`` that planning has to keep."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pianobot_ros.cell.config import load_provenance
from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.cell.geometry import WristPose

__all__ = ["WristLimits", "wrist_limits"]


@dataclass(frozen=True)
class WristLimits:
    """Limits of the wrist frame in the base frame: m/s, m/s^2, rad/s, rad/s^2, rad, and a box in m; ``home`` (3,) m."""

    speed: float
    acceleration: float
    angular_speed: float
    angular_acceleration: float
    tilt: float
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    home: tuple[float, float, float]

    def refusal(self, pose: WristPose) -> str:
        """Why the pose is not allowed, or an empty string."""
        for axis, value, low, high in zip("xyz", pose.position, self.low, self.high, strict=True):
            if not low <= value <= high:
                return f"the wrist would be at {axis} = {value:.3f} m, outside the workspace {low:g} to {high:g} m"
        tilt = float(pose.rotation.magnitude())
        return f"the wrist would tilt by {tilt:.2f} rad, allowed are {self.tilt:g}" if tilt > self.tilt else ""


@lru_cache(maxsize=8)
def wrist_limits(path: str = "wrist.yaml") -> WristLimits:
    """The limits of the configuration in force."""
    found = {name: entry["value"] for name, entry in load_provenance(path).items()}

    def box(name: str) -> tuple[float, float, float]:
        x, y, z = _need(found, name, path)
        return float(x), float(y), float(z)

    def number(name: str) -> float:
        return float(_need(found, f"limits.{name}", path))

    return WristLimits(
        speed=number("speed"),
        acceleration=number("acceleration"),
        angular_speed=number("angular_speed"),
        angular_acceleration=number("angular_acceleration"),
        tilt=number("tilt"),
        low=box("workspace.low"),
        high=box("workspace.high"),
        home=box("mount.home"),
    )


def _need(found: dict[str, Sequence[float]], name: str, path: str) -> np.ndarray:
    if name not in found:
        raise ConfigError(f"{path}: {name} is missing")
    return np.asarray(found[name], dtype=float)
