"""How the engine is set for the piano cell."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Annotated, Literal

from pydantic import Field

from pianobot_ros.cell.numbers.config import Section, config_dir, load_section
from pianobot_ros.gap import Calibration, Options, Scaling

__all__ = [
    "CALIBRATION",
    "Figures",
    "Group",
    "Learned",
    "Origin",
    "Reached",
    "Scale",
    "Sureness",
    "options",
    "prior_options",
]

CALIBRATION = "calibration/diagnosis.yaml"
"""What ``benchmarks/calibrate.py`` learned, in the configuration's directory."""


Group = Literal["effect", "unknown", "quiet"]
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


class Reached(Section):
    """What the learned does on the cells that it was learned from, and on cells left out."""

    views: int
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
    """What ``benchmarks/calibrate.py`` writes, by group of first answers: how sure to be and what a
    credible set must hold; how that did, and where it is from.
    """

    scaling: dict[Group, Scale] = Field(default_factory=dict)
    levels: dict[Group, Annotated[float, Field(gt=0, lt=1)]]
    reached: Reached | None = None
    provenance: Origin | None = None


def prior_options() -> Options:
    """The settings before anything is learned.

    The cell's twin is right to a few thousandths of a signal, so what an effect leaves open says
    more than elsewhere. Its force has ten thousand samples, and in a cell without any effect
    hypotheses still differ by a hundred nats.
    """
    return Options(calibration=Calibration(temperature=15.0, unknown_near=0.3))


@cache
def options() -> Options:
    """The settings, with what was learned where there is any. Raises :class:`ConfigError` for
    a file that does not hold them.
    """
    path = config_dir() / CALIBRATION
    if not path.is_file():
        return prior_options()
    learned = load_section(path, Learned)
    scaling = {str(g): Scaling(**scale.model_dump()) for g, scale in learned.scaling.items()}
    levels = {str(g): level for g, level in learned.levels.items()}
    return Options(calibration=replace(prior_options().calibration, scaling=scaling, levels=levels))
