"""Stiffness against vacuum: k at each jamming level, loading and unloading apart, and the calibration file of the twin."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.optimize import isotonic_regression

from pianobot_ros.cell.errors import PianobotError, RecordingError
from pianobot_ros.identify.stiffness import PAPER_RANGE, Misfit, profile_stiffness
from pianobot_ros.identify.takes import Take

__all__ = ["Level", "VacuumCurve", "identify_vacuum", "write_calibration"]

LEVEL_WIDTH = 5e3  # Pa: pressures closer than this are one level
STEADY = 3e3  # Pa: vacuum that moves by more than this while the finger is on the key is no level
MOVED = 10e3  # Pa: a change of vacuum large enough to say from which side a level was reached


@dataclass(frozen=True)
class Level:
    """Stiffness at one level: ``branch`` is loading (vacuum was increased to it), unloading (decreased) or all."""

    pressure: float
    branch: str
    stiffness: float
    low: float
    high: float
    strikes: int
    identifiable: bool


@dataclass(frozen=True)
class VacuumCurve:
    """Result of :func:`identify_vacuum`: levels, and where loading and unloading differ beyond their intervals."""

    levels: tuple[Level, ...]
    hysteresis: tuple[dict[str, float], ...]
    warnings: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """The result as plain data for JSON."""
        return asdict(self)


def identify_vacuum(takes: Sequence[Take], bounds: tuple[float, float] = PAPER_RANGE) -> VacuumCurve:
    """Identify k at each vacuum level of the strikes, for all of them and by the side from which the level was reached.

    The level of a strike is the vacuum measured while the finger was on the key; strikes during which it still moved are left
    out, with a warning. Raises :class:`RecordingError` where fewer than two levels remain.
    """
    misfit = Misfit(sorted(takes, key=lambda t: t.strike.start))
    groups: dict[int, list[tuple[str, int]]] = defaultdict(list)
    pressures: dict[int, float] = {}
    previous, branch, moving = None, "loading", 0
    for i, take in enumerate(misfit.takes):
        during = take.pressure_in_contact()
        pressure = float(np.mean(during)) if np.isfinite(during).all() else take.strike.pressure
        if previous is not None and abs(pressure - previous) > MOVED:
            branch = "loading" if pressure < previous else "unloading"
        previous = pressure
        if np.ptp(during) > STEADY:
            moving += 1
            continue
        pressures[i] = pressure
        groups[round(pressure / LEVEL_WIDTH)].append((branch, i))
    warnings = []
    if moving:
        warnings.append(
            f"{moving} strikes were left out: their vacuum changed by more than {STEADY / 1e3:.0f} kPa on the key"
        )
    if len(groups) < 2:
        raise RecordingError(
            f"stiffness against vacuum needs strikes at two or more steady levels, found {len(groups)}: play the phrase repeats"
        )
    levels: list[Level] = []
    hysteresis = []
    for key in sorted(groups, reverse=True):
        members = groups[key]
        pressure = float(np.mean([pressures[i] for _, i in members]))
        levels.append(whole := _level(misfit, pressure, "all", [i for _, i in members], bounds))
        if not whole.identifiable:
            warnings.append(
                f"stiffness at {pressure / 1e3:.0f} kPa cannot be identified: {whole.low:.3g} to {whole.high:.3g} N*m/rad fit"
            )
        sides = {side: [i for b, i in members if b == side] for side in ("loading", "unloading")}
        if all(len(s) >= 2 for s in sides.values()):
            up, down = (_level(misfit, pressure, side, s, bounds) for side, s in sides.items())
            levels += [up, down]
            if up.high < down.low or down.high < up.low:
                hysteresis.append({"pressure": pressure, "loading": up.stiffness, "unloading": down.stiffness})
    return VacuumCurve(tuple(levels), tuple(hysteresis), tuple(warnings))


def _level(misfit: Misfit, pressure: float, branch: str, members: Sequence[int], bounds: tuple[float, float]) -> Level:
    found = profile_stiffness(misfit.takes, bounds, misfit=misfit, members=members)
    return Level(pressure, branch, found.best, found.low, found.high, len(members), found.identifiable)


def write_calibration(curve: VacuumCurve, path: str | Path, source: str) -> Path:
    """Write the curve as a calibration file that the twin loads (``calibration/stiffness.yaml``).

    Stiffness must rise with vacuum: values that do not are pooled with their neighbours. Raises :class:`PianobotError` if no
    level could be identified.
    """
    levels = [level for level in curve.levels if level.branch == "all" and level.identifiable]
    if len(levels) < 2:
        raise PianobotError("fewer than two levels could be identified: nothing was written")
    levels.sort(key=lambda level: -level.pressure)
    weights = [1 / max(np.log(level.high / level.low), 1e-3) ** 2 for level in levels]
    rising = np.exp(isotonic_regression(np.log([level.stiffness for level in levels]), weights=weights).x)
    intervals = ", ".join(f"{level.low:.3g} to {level.high:.3g}" for level in levels)
    content = {
        "pressure": {"value": [round(level.pressure) for level in levels], "unit": "Pa", "source": f"played in {source}"},
        "stiffness": {
            "value": [round(float(k), 4) for k in rising], "unit": "N*m/rad",
            "source": f"identified from {source} by `pianobot identify vacuum`", "note": f"95 % intervals: {intervals}",
        },
    }  # fmt: skip
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    text = "# Joint stiffness against vacuum: monotone interpolation (PCHIP) between the jamming levels.\n"
    path.write_text(text + yaml.safe_dump(content, sort_keys=False, allow_unicode=True), encoding="utf-8")
    return path
