"""The figures of scored blind cases."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pianobot_ros.piano.blind.reliability import calibration_error, chance_error

__all__ = ["BAND", "Figure", "figures"]

BAND = 3.0
"""Magnitude (in floors) that separates the two bands."""


@dataclass(frozen=True)
class Figure:
    """One figure: ``value`` (a share or in ``unit``, NaN without cases) over ``cases``, with what
    was asked for.
    """

    name: str
    value: float
    cases: int
    least: str = ""
    goal: str = ""
    unit: str = "%"

    def text(self) -> str:
        """The value with its unit."""
        if np.isnan(self.value):
            return "–"
        if self.unit == "%":
            return f"{100 * self.value:.0f} %"
        return f"{self.value:.1f} {self.unit}" if self.unit else f"{self.value:.2f}"


Row = dict[str, Any]
Test = Callable[[Row], Any]


def figures(rows: Sequence[Row]) -> list[Figure]:
    """All figures of the rows of :func:`~pianobot_ros.piano.blind.scorecard.score_cases`."""
    return [*_effects(rows), *_credibility(rows), *_refusals(rows), *_gaps(rows), *_others(rows)]


def _of(rows: Sequence[Row], *kinds: str) -> list[Row]:
    return [r for r in rows if r["kind"] in kinds]


def _share(name: str, chosen: Sequence[Row], test: Test, least: str = "", goal: str = "") -> Figure:
    return Figure(name, _mean([bool(test(r)) for r in chosen]), len(chosen), least, goal)


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else float("nan")


def _median(values: Sequence[float]) -> float:
    return float(np.median(values)) if values else float("nan")


def _right(r: Row) -> bool:
    return bool(r["answer"] == r["truth"])


def _effects(rows: Sequence[Row]) -> list[Figure]:
    effect = _of(rows, "effect")
    strong = [r for r in effect if r["strength"] >= BAND]
    weak = [r for r in effect if r["strength"] < BAND]
    return [
        _share("right effect first, gap ≥ 3 × floor", strong, _right, "85 %", "95 %"),
        _share("right effect first, gap 1 to 3 × floor", weak, _right, "60 %", "80 %"),
        _share(
            "right effect first, whatever else is named", effect, lambda r: r["leads"] == r["truth"]
        ),
        _share(
            "right, or declared inseparable from it",
            effect,
            lambda r: _right(r) or r["inseparable"],
        ),
    ]


def _credibility(rows: Sequence[Row]) -> list[Figure]:
    given = [r["p"] for r in rows]
    error = calibration_error(given, [r["first_right"] for r in rows])
    name = "expected calibration error of the first answer"
    right = [r for r in rows if r["answer"] == r["truth"] and r["truth"] != "unknown"]
    held = [x for r in right for x in r["held"]]
    interval = "95 % intervals that hold the parameter, where the answer is right"
    return [
        Figure(interval, _mean(held), len(held), "", "95 %"),
        _share("truth inside the 95 % credible set", rows, lambda r: r["covered"], "93 %", "97 %"),
        Figure("mean size of that set", _mean([r["size"] for r in rows]), len(rows), "", "3", ""),
        Figure(name, error, len(rows), "", "0.05", ""),
        Figure("the same by chance, were they right", chance_error(given), len(rows), "", "", ""),
    ]


def _refusals(rows: Sequence[Row]) -> list[Figure]:
    def called(verdict: str) -> Test:
        return lambda r: r["verdict"] == verdict

    none, parameters = _of(rows, "none"), _of(rows, "parameters")
    unknown, withheld, two = _of(rows, "unknown"), _of(rows, "withheld"), _of(rows, "two")
    strong = [r for r in two if r["weaker"] >= BAND]
    asked: list[tuple[str, list[Row], Test, str, str]] = [
        ("right stage", _of(rows, "effect"), lambda r: r["stage"], "95 %", "98 %"),
        ("none-cases called something", none, lambda r: r["verdict"] != "none", "≤ 5 %", "≤ 2 %"),
        (
            "parameter-error-only cases called an effect",
            parameters,
            called("effect"),
            "≤ 7 %",
            "≤ 3 %",
        ),
        ("left-out effects called unknown", unknown, called("unknown"), "75 %", "90 %"),
        (
            "withheld families called unknown or a declared relative",
            withheld,
            lambda r: r["verdict"] == "unknown" or r["relative"],
            "",
            "85 %",
        ),
        ("withheld families called unknown", withheld, called("unknown"), "", ""),
        ("both of two effects named", two, _both, "65 %", "85 %"),
        (f"… where each is of {BAND:g} floors and more", strong, _both, "", ""),
        ("at least one of two effects named", two, lambda r: r["wanted"] & r["named"], "", ""),
    ]
    return [_share(*one) for one in asked]


def _both(row: Row) -> bool:
    return bool(row["wanted"] <= row["named"])


def _gaps(rows: Sequence[Row]) -> list[Figure]:
    closed = [
        r["gap"]
        for r in _of(rows, "effect")
        if r["gap"].get("closed") is not None and r["gap"]["before"] - r["gap"]["floor"] > 0.1
    ]
    refit = [(g["before"] - g["refit"]) / (g["before"] - g["floor"]) for g in closed]
    name = "gap above the floor closed, held out, effect in library"
    return [
        Figure(name, _median([g["closed"] for g in closed]), len(closed), "80 %", "90 %"),
        Figure("the same by parameter fitting alone", _median(refit), len(closed)),
    ]


def _others(rows: Sequence[Row]) -> list[Figure]:
    runtimes = [r["runtime"] for r in rows if np.isfinite(r["runtime"])]
    effect = _of(rows, "effect")
    by = "right effect first by {} on the same fits"
    return [
        _share(by.format("AIC"), effect, lambda r: r["aic"] == r["truth"]),
        _share(by.format("BIC"), effect, lambda r: r["bic"] == r["truth"]),
        _share(
            "none- and parameter-cases called an effect by BIC",
            _of(rows, "none", "parameters"),
            lambda r: r["bic"] not in ("none", "parameters"),
        ),
        Figure(
            "median time of a diagnosis", _median(runtimes), len(runtimes), "120 s", "60 s", "s"
        ),
    ]
