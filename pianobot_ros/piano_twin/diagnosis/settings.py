"""How the engine is set for the piano cell."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

from pydantic import Field

from pianobot_ros.cell.numbers.config import Section, config_dir, load_section
from pianobot_ros.gap import Calibration, Options

__all__ = ["CALIBRATION", "options", "prior_options"]

CALIBRATION = "calibration/diagnosis.yaml"
"""What ``benchmarks/calibrate.py`` learned, in the configuration's directory."""


class Learned(Section):
    """What ``benchmarks/calibrate.py`` writes: constants, how they did, and where they are from."""

    temperature: float = Field(gt=0)
    event_temperature: float = Field(gt=0)
    levels: dict[str, float]
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
    calibration = replace(
        prior_options().calibration,
        temperature=learned.temperature,
        event_temperature=learned.event_temperature,
        levels=learned.levels,
    )
    return Options(calibration=calibration)
