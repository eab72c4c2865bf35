"""All parameters of the cell at once, with the error on strikes that were not fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pianobot_ros.cell.errors import PianobotError, unknown_name
from pianobot_ros.piano.identify.cell.answer import CellAnswer, Known, err_of, identify_cell
from pianobot_ros.piano.identify.cell.cell_fit import CellProblem
from pianobot_ros.piano.identify.priors import priors
from pianobot_ros.piano.identify.takes.levels import level_name
from pianobot_ros.piano.identify.takes.take import Take

__all__ = ["PARAMETERS", "ParameterFit", "fit_parameters"]

PARAMETERS = tuple(p.name for p in priors() if not p.missing)
"""What is estimated. ``joint_stiffness`` is one factor for each vacuum level."""
FEWEST_TO_SPLIT = 4


@dataclass(frozen=True)
class ParameterFit:
    """Result of :func:`fit_parameters`: values with 90 % intervals, Err of Eq. 5 (fractions) before
    and after on the fitted strikes and after on the others, warnings.
    """

    estimates: tuple[Known, ...]
    err_before: float
    err_after: float
    err_held_out: float
    decides: str
    warnings: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """The result as plain data for JSON."""
        return asdict(self)


def fit_parameters(takes: Sequence[Take], names: Sequence[str] = PARAMETERS) -> ParameterFit:
    """Estimate everything that is not known; ``names`` says which of it is shown.

    Every other take is held out for the error given. Raises :class:`PianobotError` for unknown
    names.
    """
    for name in names:
        if name not in PARAMETERS:
            raise PianobotError(unknown_name("parameter", name, PARAMETERS))
    used = [t for t in takes if t.reference is not None]
    enough = len(used) >= FEWEST_TO_SPLIT
    fitted, held = (used[::2], used[1::2]) if enough else (used, used)
    found = identify_cell(fitted)
    shown = tuple(k for k in found.known if k.name.split(" ")[0] in names)
    warnings = [
        f"{k.name}: hardly known from these data" + (f"; {k.combination}" if k.combination else "")
        for k in shown
        if not k.identifiable
    ]
    return ParameterFit(
        shown,
        found.err_before,
        found.err_after,
        _held_out(found, held),
        found.decides,
        tuple(warnings),
    )


def _held_out(found: CellAnswer, held: Sequence[Take]) -> float:
    """Err of Eq. 5 (fraction) of the fitted cell on other strikes."""
    problem = CellProblem(held)
    known = dict(zip(found.problem.names, found.joint.x, strict=True))
    pressures = np.array(found.pressures)
    nearest = {
        level_name(p): level_name(found.pressures[int(np.argmin(np.abs(pressures - p)))])
        for p in problem.levels.pressures
    }
    x = np.array([known.get(n, known.get(nearest.get(n, ""), 0.0)) for n in problem.names])
    names = [p.name for p in found.problem.missing]
    effects = dict(zip(names, found.joint.effects, strict=True))
    return err_of(problem, x, np.array([effects.get(p.name, 0.0) for p in problem.missing]))
