"""Numbers of the nominal laws that twin and plant each put into their own formulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pydantic import model_validator

from pianobot_ros.cell.errors import ConfigError, unknown_name
from pianobot_ros.cell.numbers.config import Section, load_section, quantity

__all__ = [
    "PARAMETERS",
    "StiffnessCalibration",
    "WristServo",
    "check_factors",
    "stiffness_calibration",
    "wrist_servo",
]

PARAMETERS = (
    "joint_stiffness",
    "joint_damping",
    "key_stiffness",
    "key_damping",
    "key_inertia",
    "fsr_gain",
    "midi_velocity_gain",
)
"""Parameters whose values may be wrong without any structure missing; each is a factor, nominally
1.
"""


class StiffnessCalibration(Section):
    """Joint stiffness against vacuum (``config/calibration/stiffness.yaml``)."""

    pressure: tuple[float, ...] = quantity("Pa")
    stiffness: tuple[float, ...] = quantity("N*m/rad")

    @model_validator(mode="after")
    def _curve(self) -> StiffnessCalibration:
        if len(self.pressure) != len(self.stiffness) or len(self.pressure) < 2:
            raise ValueError("pressure and stiffness must have the same length, at least 2")
        if len(set(self.pressure)) < len(self.pressure) or max(self.pressure) > 0:
            raise ValueError("pressure must be gauge, at most 0, and each level stand there once")
        if min(self.stiffness) <= 0:
            raise ValueError("stiffness must be above 0 at every level")
        return self


class WristServo(Section):
    """How the wrist follows its command (``config/wrist_model.yaml``)."""

    natural_frequency: float = quantity("rad/s", low=1)
    damping_ratio: float = quantity("1", low=0.05)


def stiffness_calibration() -> StiffnessCalibration:
    """Joint stiffness against vacuum, by the configuration in force."""
    return load_section("calibration/stiffness.yaml", StiffnessCalibration)


def wrist_servo() -> WristServo:
    """The wrist's servo, by the configuration in force."""
    return load_section("wrist_model.yaml", WristServo, "servo")


def check_factors(factors: Mapping[str, float], names: Sequence[str]) -> None:
    """Raises :class:`ConfigError` unless every factor is of one of ``names`` and between 0.1 and
    10.
    """
    for name, factor in factors.items():
        if name not in names:
            raise ConfigError(unknown_name("parameter", name, names))
        if not 0.1 <= factor <= 10:
            raise ConfigError(
                f"parameter {name} is scaled by {factor}: give a factor between 0.1 and 10"
            )
