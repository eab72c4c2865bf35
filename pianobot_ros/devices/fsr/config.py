"""Configuration of the force sensor and the key encoder (``config/fsr.yaml``)."""

from __future__ import annotations

from itertools import pairwise
from typing import Literal

from pydantic import model_validator

from pianobot_ros.cell.numbers.config import Section, quantity
from pianobot_ros.devices.base import DeviceConfig
from pianobot_ros.devices.serial_line import LinkConfig

__all__ = [
    "CalibrationConfig",
    "EncoderConfig",
    "FsrConfig",
    "PressConfig",
    "SensorConfig",
]


class SensorConfig(Section):
    """The sensor and its converter."""

    note: int = quantity("1", low=0, high=127)
    bits: int = quantity("1", low=8, high=16)
    rate: float = quantity("Hz", low=1, high=1000)
    clock: Literal["fixed", "tracked", "arrival"]
    latency: float = quantity("s", low=0, high=0.1)


class CalibrationConfig(Section):
    """Points of the calibration curve."""

    counts: tuple[float, ...] = quantity("1")
    force: tuple[float, ...] = quantity("N")

    @model_validator(mode="after")
    def _monotone(self) -> CalibrationConfig:
        if len(self.counts) != len(self.force) or len(self.counts) < 2:
            raise ValueError("counts and force must have the same length, at least 2")
        for name, values in (("counts", self.counts), ("force", self.force)):
            if any(b <= a for a, b in pairwise(values)):
                raise ValueError(f"{name} must rise from point to point")
        return self


class PressConfig(Section):
    """When a press is a press."""

    threshold: float = quantity("N", low=0)
    period: float = quantity("s", low=0.001, high=1)


class EncoderConfig(Section):
    """The key encoder: ``resolution`` counts per metre at the key's front."""

    fitted: bool
    resolution: float = quantity("1/m", low=1)
    velocity_window: float = quantity("s", low=0.001, high=0.5)


class FsrConfig(DeviceConfig):
    """The whole file."""

    link: LinkConfig
    sensor: SensorConfig
    calibration: CalibrationConfig
    press: PressConfig
    encoder: EncoderConfig

    @model_validator(mode="after")
    def _within_the_converter(self) -> FsrConfig:
        most = 2**self.sensor.bits - 1
        if self.calibration.counts[-1] > most:
            raise ValueError(
                f"calibration: {self.calibration.counts[-1]:g} counts are more than a converter of"
                f" {self.sensor.bits} bits can say ({most}): set sensor.bits, and weigh the sensor"
                " in anew"
            )
        return self
