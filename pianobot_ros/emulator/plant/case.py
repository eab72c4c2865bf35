"""What one emulated cell is: which effects it has and how strong, which parameters are off, and its random seed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pianobot_ros.cell.errors import ConfigError, unknown_name
from pianobot_ros.emulator.plant.effects import EFFECTS, physical_parameters

__all__ = ["PARAMETERS", "Case"]

PARAMETERS = (
    "joint_stiffness",
    "joint_damping",
    "key_stiffness",
    "key_damping",
    "key_inertia",
    "fsr_gain",
    "midi_velocity_gain",
)
"""The parameters whose values may be wrong without any structure missing; each is a factor, nominally 1."""


@dataclass(frozen=True)
class Case:
    """One cell. ``effects`` name to magnitude in units of the repeatability floor (1 to 10); ``parameters`` name to factor;
    ``physical`` effect to its physical parameter, for those who want it in its own unit.

    ``repeatability`` scales the strike-to-strike variation and ``noise`` the sensor noise (0 switches them off).
    """

    effects: Mapping[str, float] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)
    physical: Mapping[str, float] = field(default_factory=dict)
    seed: int = 0
    repeatability: float = 1.0
    noise: float = 1.0

    def __post_init__(self) -> None:
        for name in (*self.effects, *self.physical):
            if name not in EFFECTS:
                raise ConfigError(unknown_name("effect", name, EFFECTS))
        for name, factor in self.parameters.items():
            if name not in PARAMETERS:
                raise ConfigError(unknown_name("parameter", name, PARAMETERS))
            if not 0.1 <= factor <= 10:
                raise ConfigError(f"parameter {name} is scaled by {factor}: give a factor between 0.1 and 10")

    def strengths(self) -> dict[str, float]:
        """Physical parameter of every effect of this case."""
        return {**physical_parameters(self.effects), **self.physical}

    def to_json(self) -> dict[str, Any]:
        """As plain JSON."""
        return {
            "effects": dict(self.effects), "parameters": dict(self.parameters),
            "physical": dict(self.physical), "seed": self.seed, "repeatability": self.repeatability, "noise": self.noise,
        }  # fmt: skip

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Case:
        """From :meth:`to_json`; missing entries are nominal."""
        return cls(
            {str(k): float(v) for k, v in data.get("effects", {}).items()},
            {str(k): float(v) for k, v in data.get("parameters", {}).items()},
            {str(k): float(v) for k, v in data.get("physical", {}).items()},
            int(data.get("seed", 0)), float(data.get("repeatability", 1.0)), float(data.get("noise", 1.0)),
        )  # fmt: skip
