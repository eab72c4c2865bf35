"""Configuration of the arm (``config/wrist.yaml``)."""

from __future__ import annotations

from pathlib import Path

from pydantic import model_validator

from pianobot_ros.cell.config import Section, load_section, quantity

__all__ = ["LimitsConfig", "LinkConfig", "MountConfig", "ServoConfig", "UrConfig", "WorkspaceConfig", "load_config"]


class LinkConfig(Section):
    """Where the controller is, and when its link counts as dead."""

    host: str
    rate: float = quantity("Hz", low=0, high=500)
    connect_timeout: float = quantity("s", low=2, high=60)
    state_timeout: float = quantity("s", low=0.02, high=2)
    watchdog_rate: float = quantity("Hz", low=2, high=50)


class MountConfig(Section):
    """How the hand sits on the flange."""

    rotation: tuple[float, float, float] = quantity("rad")
    tcp_offset: tuple[float, float, float] = quantity("m")
    home: tuple[float, float, float] = quantity("m")
    payload: float = quantity("kg", low=0, high=5)
    payload_centre: tuple[float, float, float] = quantity("m")


class ServoConfig(Section):
    """Arguments of ``servoL`` and ``servoStop``; the ranges are those of the URScript manual."""

    ahead: float = quantity("1", low=0, high=5)
    lookahead: float = quantity("s", low=0.03, high=0.2)
    gain: float = quantity("1", low=100, high=2000)
    stop_deceleration: float = quantity("m/s^2", low=1, high=100)


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


class UrConfig(Section):
    """Everything in ``wrist.yaml``."""

    link: LinkConfig
    mount: MountConfig
    servo: ServoConfig
    limits: LimitsConfig
    workspace: WorkspaceConfig


def load_config(path: str | Path = "wrist.yaml") -> UrConfig:
    """Load a file, or the one of that name in the configuration directory. Raises ConfigError."""
    return load_section(path, UrConfig)
