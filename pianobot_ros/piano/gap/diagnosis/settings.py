"""How the engine is set for the piano cell."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import cache
from typing import Annotated, Any

from pydantic import AfterValidator, Field

from pianobot_ros.cell.numbers.config import Section, config_dir, load_section
from pianobot_ros.gap import Calibration, Options

__all__ = ["CALIBRATION", "options", "prior_options"]

CALIBRATION = "calibration/diagnosis.yaml"
"""What ``benchmarks/calibrate.py`` learned, in the configuration's directory."""


NAMES = frozenset(f.name for f in fields(Calibration)) - {"levels"}


def _known(name: str) -> str:
    if name not in NAMES:
        raise ValueError(f"no constant of the diagnosis; there are {', '.join(sorted(NAMES))}")
    return name


Constant = Annotated[str, AfterValidator(_known)]


class Learned(Section):
    """What ``benchmarks/calibrate.py`` writes: constants, how they did, and where they are from."""

    constants: dict[Constant, float] = Field(default_factory=dict)
    levels: dict[str, Annotated[float, Field(gt=0, lt=1)]]
    reached: dict[str, Any] = Field(default_factory=dict)
    provenance: dict[str, Any] = Field(default_factory=dict)


def prior_options() -> Options:
    """The settings before anything is learned.

    The cell's twin is right to a few thousandths of a signal, so what an effect leaves open says
    more than elsewhere. Its force has ten thousand samples, and in a cell without any effect
    hypotheses still differ by a hundred nats.
    """
    return Options(calibration=Calibration(temperature=15.0, unknown_near=0.3))


@cache
def options() -> Options:
    """The settings, with the learned constants where there are any. Raises :class:`ConfigError` for
    a file that does not hold them.
    """
    path = config_dir() / CALIBRATION
    if not path.is_file():
        return prior_options()
    learned = load_section(path, Learned)
    constants: dict[str, Any] = {**learned.constants, "levels": learned.levels}
    return Options(calibration=replace(prior_options().calibration, **constants))
