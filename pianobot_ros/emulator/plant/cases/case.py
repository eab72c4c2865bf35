"""What one emulated cell is: which effects it has and how strong, which parameters are off, and its
random seed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pianobot_ros.cell.numbers.nominal import PARAMETERS, check_factors
from pianobot_ros.emulator.plant.cases.effects import EFFECTS, physical_parameters, split_law

__all__ = ["PARAMETERS", "Case"]


@dataclass(frozen=True)
class Case:
    """One cell. ``effects`` name to magnitude in units of the repeatability floor (1 to 10);
    ``parameters`` name to factor; ``physical`` effect to its physical parameter, for those who want
    it in its own unit; ``laws`` effect to the law by which it acts (0 where nothing is said). An
    effect may be named with its law: ``{"joint_friction_law1": 3.0}``.

    ``repeatability`` scales the strike-to-strike variation and ``noise`` the sensor noise (0
    switches them off).
    """

    effects: Mapping[str, float] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)
    physical: Mapping[str, float] = field(default_factory=dict)
    seed: int = 0
    repeatability: float = 1.0
    noise: float = 1.0
    laws: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        laws = {name: int(law) for name, law in self.laws.items() if law}
        for attribute in ("effects", "physical"):
            plain = {}
            for name, size in getattr(self, attribute).items():
                effect, law = split_law(name)
                plain[effect] = size
                if law:
                    laws[effect] = law
            object.__setattr__(self, attribute, plain)
        for name, law in laws.items():
            split_law(f"{name}_law{law}")
        object.__setattr__(self, "laws", laws)
        check_factors(self.parameters, PARAMETERS)

    def strengths(self) -> dict[str, float]:
        """Physical parameter of every effect of this case."""
        return {**physical_parameters(self.effects, self.laws), **self.physical}

    def in_session(self, index: int) -> Case:
        """The same cell another time: strikes, sensors and wander are drawn anew, nothing else
        differs. Session 0 is this case's own.
        """
        if index == 0:
            return self
        (seed,) = np.random.SeedSequence([self.seed, index]).generate_state(1)
        return replace(self, seed=int(seed) & 0x7FFFFFFF)  # below 2**31, as all drawn seeds are

    def constants(self, fields: Iterable[str]) -> dict[str, Any]:
        """What a record of constants takes of this case: for each of its ``fields`` that is an
        effect the physical parameter, 0 without it, and for ``EFFECT_law`` the law it acts by.
        """
        strength, known = self.strengths(), set(fields)
        sizes = {name: strength.get(name, 0.0) for name in EFFECTS if name in known}
        return sizes | {f"{n}_law": self.laws.get(n, 0) for n in sizes if f"{n}_law" in known}

    def to_json(self) -> dict[str, Any]:
        """As plain JSON."""
        return {
            "effects": dict(self.effects),
            "parameters": dict(self.parameters),
            "physical": dict(self.physical),
            "seed": self.seed,
            "repeatability": self.repeatability,
            "noise": self.noise,
            "laws": dict(self.laws),
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Case:
        """From :meth:`to_json`; missing entries are nominal."""
        return cls(
            {str(k): float(v) for k, v in data.get("effects", {}).items()},
            {str(k): float(v) for k, v in data.get("parameters", {}).items()},
            {str(k): float(v) for k, v in data.get("physical", {}).items()},
            int(data.get("seed", 0)),
            float(data.get("repeatability", 1.0)),
            float(data.get("noise", 1.0)),
            {str(k): int(v) for k, v in data.get("laws", {}).items()},
        )
