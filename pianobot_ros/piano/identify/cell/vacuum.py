"""Stiffness against vacuum: k at each jamming level, loading and unloading apart, and the
calibration file of the twin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import isotonic_regression

from pianobot_ros.cell.errors import PianobotError, RecordingError
from pianobot_ros.cell.numbers.bounded_files import yaml_text
from pianobot_ros.cell.numbers.shown import in_kpa
from pianobot_ros.cell.numbers.whole_files import write_whole
from pianobot_ros.piano.identify.cell.answer import CellAnswer, Known, identify_cell
from pianobot_ros.piano.identify.takes.levels import STEADY, Levels, level_name, side_name
from pianobot_ros.piano.identify.takes.take import Take

__all__ = ["Level", "VacuumCurve", "identify_vacuum", "write_calibration"]

SMALLEST = 0.04  # of the stiffness: less between loading and unloading is not called hysteresis


@dataclass(frozen=True)
class Level:
    """Stiffness at one level with its 90 % interval: ``branch`` is loading (vacuum was increased to
    it), unloading (decreased) or all.
    """

    pressure: float
    branch: str
    stiffness: float
    low: float
    high: float
    strikes: int
    identifiable: bool
    combination: str = ""


@dataclass(frozen=True)
class VacuumCurve:
    """Result of :func:`identify_vacuum`: levels, where loading and unloading differ beyond their
    intervals, all else that was estimated (``known``), and which recording would close what is open
    (``decides``, "" if nothing is).
    """

    levels: tuple[Level, ...]
    hysteresis: tuple[dict[str, float], ...]
    known: tuple[Known, ...]
    decides: str
    warnings: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """The result as plain data for JSON."""
        return asdict(self)


def identify_vacuum(takes: Sequence[Take]) -> VacuumCurve:
    """Identify k at each vacuum level of the strikes together with everything else that is not
    known, and by the side from which the level was reached.

    The level of a strike is the vacuum measured while the finger was on the key; strikes during
    which it still moved count by interpolation between the levels. Raises :class:`RecordingError`
    where there are fewer than two levels.
    """
    levels = Levels(takes)
    if len(levels.pressures) < 2 or sum(levels.steady) < 2:
        raise RecordingError(
            "stiffness against vacuum needs strikes at two or more steady levels, found"
            f" {len(levels.pressures) if any(levels.steady) else 0}: play the phrase repeats"
        )
    found = identify_cell(takes)
    warnings = []
    if moving := len(takes) - sum(levels.steady):
        warnings.append(
            f"during {moving} strikes the vacuum changed by more than {in_kpa(STEADY)}: they"
            " count by interpolation between the levels"
        )
    warnings += [
        _open(k, p)
        for k, p in zip(found.levels, found.pressures, strict=True)
        if not k.identifiable
    ]
    rows: list[Level] = []
    hysteresis = []
    for i in reversed(range(len(levels.pressures))):
        known, pressure = found.levels[i], levels.pressures[i]
        rows.append(
            Level(
                pressure,
                "all",
                known.value,
                known.low,
                known.high,
                len(levels.members(i)),
                known.identifiable,
                known.combination,
            )
        )
        if side_name(pressure) in found.problem.names:
            up, down, apart = _branches(found, levels, i)
            rows += [up, down]
            if apart:
                hysteresis.append(
                    {"pressure": pressure, "loading": up.stiffness, "unloading": down.stiffness}
                )
    return VacuumCurve(tuple(rows), tuple(hysteresis), found.known, found.decides, tuple(warnings))


def _open(known: Known, pressure: float) -> str:
    more = f"; {known.combination}" if known.combination else ""
    return (
        f"stiffness at {in_kpa(pressure)} cannot be identified: {known.low:.3g} to"
        f" {known.high:.3g} N*m/rad fit{more}"
    )


def _branches(found: CellAnswer, levels: Levels, i: int) -> tuple[Level, Level, bool]:
    """Stiffness on loading and on unloading at level i, and whether they differ for sure."""
    problem, joint, pressure = found.problem, found.joint, levels.pressures[i]
    whole, own = (problem.names.index(f(pressure)) for f in (level_name, side_name))
    prior = problem.parameters[own]
    turn = np.log(prior.value(float(joint.x[own])))
    branches = []
    for name, sign in (("loading", 1.0), ("unloading", -1.0)):
        direction = np.zeros(len(problem.names))
        direction[whole] = problem.parameters[whole].sd
        direction[own] = sign * prior.sd
        half = joint.half(direction)
        value = found.levels[i].value * float(np.exp(sign * turn))
        branches.append(
            Level(
                pressure,
                name,
                value,
                value * float(np.exp(-half)),
                value * float(np.exp(half)),
                len(levels.members(i, sign)),
                found.levels[i].identifiable,
            )
        )
    alone = np.zeros(len(problem.names))
    alone[own] = prior.sd
    return branches[0], branches[1], abs(turn) > max(joint.half(alone), SMALLEST / 2)


def write_calibration(curve: VacuumCurve, path: str | Path, source: str) -> Path:
    """Write the curve as a calibration file that the twin loads (``calibration/stiffness.yaml``).

    Stiffness must rise with vacuum: values that do not are pooled with their neighbours. Raises
    :class:`PianobotError` where a level is open, naming the recording that would decide it.
    """
    levels = [level for level in curve.levels if level.branch == "all"]
    if still := [level for level in levels if not level.identifiable]:
        where = ", ".join(
            f"{in_kpa(x.pressure)} ({x.low:.3g} to {x.high:.3g} N*m/rad)" for x in still
        )
        raise PianobotError(
            f"nothing was written: stiffness is open at {where}; what would decide it:"
            f" {curve.decides}"
        )
    levels.sort(key=lambda level: -level.pressure)
    weights = [1 / max(np.log(level.high / level.low), 1e-3) ** 2 for level in levels]
    rising = np.exp(
        isotonic_regression(np.log([level.stiffness for level in levels]), weights=weights).x
    )
    intervals = ", ".join(f"{level.low:.3g} to {level.high:.3g}" for level in levels)
    content = {
        "pressure": {
            "value": [round(level.pressure) for level in levels],
            "unit": "Pa",
            "source": f"played in {source}",
        },
        "stiffness": {
            "value": [round(float(k), 4) for k in rising],
            "unit": "N*m/rad",
            "source": f"identified from {source} by `pianobot identify vacuum`",
            "note": f"90 % intervals: {intervals}",
        },
    }
    text = (
        "# Joint stiffness against vacuum: monotone interpolation (PCHIP) between the jamming"
        " levels.\n"
    )
    return write_whole(path, text + yaml_text(content))
