"""Configuration of the vacuum regulator (``config/vacuum.yaml``)."""

from __future__ import annotations

from pydantic import model_validator

from pianobot_ros.cell.numbers.config import Section, quantity
from pianobot_ros.devices.base import DeviceConfig
from pianobot_ros.devices.serial_line import LinkConfig

__all__ = ["BehaviourConfig", "PressureLimitsConfig", "RegulatorConfig"]


class PressureLimitsConfig(Section):
    """Range of the setpoints, Pa gauge."""

    lowest: float = quantity("Pa", low=-101_325, high=0)
    highest: float = quantity("Pa", low=-101_325, high=0)

    @model_validator(mode="after")
    def _ordered(self) -> PressureLimitsConfig:
        if self.lowest >= self.highest:
            raise ValueError("lowest must be below highest")
        return self


class BehaviourConfig(Section):
    """How the driver and the device behave."""

    refresh: float = quantity("s", low=0.02, high=5)
    vent_after: float = quantity("s", low=0, high=60)
    follow_tolerance: float = quantity("Pa", low=1, high=100_000)


class RegulatorConfig(DeviceConfig):
    """The whole file."""

    link: LinkConfig
    fingers: tuple[str, str, str]
    limits: PressureLimitsConfig
    behaviour: BehaviourConfig

    @model_validator(mode="after")
    def _plausible(self) -> RegulatorConfig:
        if len(set(self.fingers)) != len(self.fingers):
            raise ValueError("each finger has one channel: a name occurs twice in fingers")
        if 0.0 < self.behaviour.vent_after < 2.0 * self.behaviour.refresh:
            raise ValueError("behaviour.vent_after must be 0 or at least twice behaviour.refresh")
        return self
