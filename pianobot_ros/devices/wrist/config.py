"""Configuration of the arm (``config/wrist.yaml``)."""

from __future__ import annotations

from pydantic import model_validator

from pianobot_ros.cell.motion.limits import LimitsConfig, MountConfig, WorkspaceConfig
from pianobot_ros.cell.numbers.config import Section, quantity
from pianobot_ros.devices.base import DeviceConfig

__all__ = [
    "ControllerLinkConfig",
    "LimitsConfig",
    "MountConfig",
    "ServoConfig",
    "UrConfig",
    "WorkspaceConfig",
]


class ControllerLinkConfig(Section):
    """Where the controller is, and when its link counts as dead."""

    host: str
    rate: float = quantity("Hz", low=0, high=500)
    connect_timeout: float = quantity("s", low=2, high=60)
    state_timeout: float = quantity("s", low=0.02, high=2)
    watchdog_rate: float = quantity("Hz", low=2, high=50)


class ServoConfig(Section):
    """Arguments of ``servoL`` and ``servoStop``; the ranges are those of the URScript manual."""

    ahead: float = quantity("1", low=0, high=5)
    lookahead: float = quantity("s", low=0.03, high=0.2)
    gain: float = quantity("1", low=100, high=2000)
    stop_deceleration: float = quantity("m/s^2", low=1, high=100)


class UrConfig(DeviceConfig):
    """Everything in ``wrist.yaml``."""

    link: ControllerLinkConfig
    mount: MountConfig
    servo: ServoConfig
    limits: LimitsConfig
    workspace: WorkspaceConfig

    @model_validator(mode="after")
    def _home_is_allowed(self) -> UrConfig:
        box, home = self.workspace, self.mount.home
        for axis, low, at, high in zip("xyz", box.low, home, box.high, strict=True):
            if not low <= at <= high:
                raise ValueError(
                    f"mount.home is at {axis} = {at:g} m, outside the workspace ({low:g} to"
                    f" {high:g} m)"
                )
        return self
