"""What calibrations of the diagnosis learned, as they are written in the configuration."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from pianobot_ros.cell.numbers.config import Section, config_dir, load_section

__all__ = [
    "PIANO_CELL",
    "SERVO_AXIS",
    "Figures",
    "Group",
    "Kind",
    "Learned",
    "Origin",
    "Reached",
    "Scale",
    "Sureness",
    "Tempered",
    "load_learned",
]

PIANO_CELL, SERVO_AXIS = "calibration/diagnosis.yaml", "calibration/axis.yaml"
"""What ``benchmarks/calibrate.py`` learned from each plant, in the configuration's directory."""
Group = Literal["effect", "unknown", "quiet"]
Kind = Literal["series", "event"]
Shift = Annotated[float, Field(ge=-20.0, le=20.0)]  # nats


class Scale(Section):
    """:class:`pianobot_ros.gap.Scaling`, as it is written."""

    power: Annotated[float, Field(gt=0.0, le=20.0)] = 1.0
    unknown: Shift = 0.0
    quiet: Shift = 0.0
    hidden: Shift = 0.0


class Figures(Section):
    """How good answers are; `covered` is the share whose credible set holds the truth."""

    mean_log_loss: float
    right_first: float
    expected_calibration_error: float
    covered: float


class Sureness(Section):
    """How sure the answers of a group were, how often right, and what its scaling gains on cells
    left out, with its standard error.
    """

    views: int
    mean_probability: float
    right: float
    gain: float
    gain_error: float


class Tempered(Section):
    """What temperatures of their own gain in log loss on cells left out, with its standard error,
    and the factors of series and events that were tried.
    """

    tried: list[tuple[float, float]]
    gain: float
    gain_error: float


class Reached(Section):
    """What the learned does on the cells that it was learned from, and on cells left out."""

    views: int
    temperatures: Tempered | None = None
    groups: dict[Group, Sureness]
    before: Figures
    on_these_cells: Figures
    each_cell_left_out: Figures


class Origin(Section):
    """Where what was learned is from."""

    command: str
    plant: str
    laws: list[int]
    seed: int
    cells: int
    date: str
    version: str
    commit: str = ""


class Learned(Section):
    """What ``benchmarks/calibrate.py`` writes: the temperature of each kind of observable; by group
    of first answers how sure to be and what a credible set must hold; how that did, and where it is
    from.
    """

    temperatures: dict[Kind, Annotated[float, Field(gt=0.0)]] = Field(default_factory=dict)
    scaling: dict[Group, Scale] = Field(default_factory=dict)
    levels: dict[Group, Annotated[float, Field(gt=0, lt=1)]]
    reached: Reached | None = None
    provenance: Origin | None = None


def load_learned(name: str) -> dict[str, Any]:
    """What is in a file of the configuration's directory, as plain types; nothing without one.
    Raises :class:`ConfigError` for a file that does not hold it.
    """
    path = config_dir() / name
    return load_section(path, Learned).model_dump() if path.is_file() else {}
