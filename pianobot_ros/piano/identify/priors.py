"""What identification believes before the first strike (``config/priors.yaml``)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from pydantic import Field

from pianobot_ros.cell.numbers.config import Section, configured, load_provenance

__all__ = ["CHANNELS", "Prior", "noise_floor", "prior_of", "priors", "usual_misfit"]

CHANNELS = ("angle", "force", "onset", "hold", "velocity", "release")
"""What is compared: key angle (rad), contact force (N); moment, length (s), velocity and release
velocity (MIDI) of a note.
"""


class _Value(Section):
    log: bool = False
    mean: float
    sd: float = Field(gt=0)
    tolerance: float = Field(0.0, ge=0)


class _Missing(Section):
    sd: float = Field(gt=0)


class _Noise(Section):
    angle: float = Field(gt=0)
    force: float = Field(gt=0)
    onset: float = Field(gt=0)
    hold: float = Field(gt=0)
    velocity: float = Field(gt=0)
    release: float = Field(gt=0)


class _Usual(Section):
    angle: float = Field(gt=0)


class _File(Section):
    values: dict[str, _Value]
    missing: dict[str, _Missing]
    noise: _Noise
    usual: _Usual


@dataclass(frozen=True)
class Prior:
    """Belief about one parameter: ``mean`` and ``unit``; ``sd`` of the value, or of its logarithm
    where ``log``. ``tolerance``: standard deviation, on the scale of ``sd``, by which the model's
    own simplicity moves an estimate. ``missing``: an effect that the model leaves out; only its
    signature counts.
    """

    name: str
    mean: float
    sd: float
    unit: str
    log: bool = False
    missing: bool = False
    tolerance: float = 0.0

    def value(self, coordinate: float) -> float:
        """The value at a coordinate, which counts standard deviations from the mean."""
        if self.log:
            return float(self.mean * np.exp(self.sd * coordinate))
        return float(self.mean + self.sd * coordinate)

    def coordinate(self, value: float) -> float:
        """Standard deviations by which ``value`` lies from the mean."""
        if self.log:
            return float(np.log(value / self.mean) / self.sd)
        return float((value - self.mean) / self.sd)


_file = configured("priors.yaml", _File)


@lru_cache(maxsize=1)
def priors() -> tuple[Prior, ...]:
    """All beliefs: values in the order of the file, then missing effects."""
    file, units = _file(), load_provenance("priors.yaml")
    values = [
        Prior(n, p.mean, p.sd, str(units[f"values.{n}.mean"]["unit"]), p.log, tolerance=p.tolerance)
        for n, p in file.values.items()
    ]
    missing = [
        Prior(n, 0.0, p.sd, str(units[f"missing.{n}.sd"]["unit"]), missing=True)
        for n, p in file.missing.items()
    ]
    return (*values, *missing)


def prior_of(name: str) -> Prior:
    """The belief about ``name``. Raises KeyError where there is none."""
    return {p.name: p for p in priors()}[name]


def noise_floor() -> dict[str, float]:
    """Standard deviation of one sample of each of :data:`CHANNELS`."""
    return _file().noise.model_dump()


def usual_misfit() -> dict[str, float]:
    """What a fit leaves of some of :data:`CHANNELS` where nothing is missing."""
    return _file().usual.model_dump()
