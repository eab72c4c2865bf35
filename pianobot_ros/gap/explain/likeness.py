"""What a signal looks like beside its prediction: of the same shape, but turned, of another size
altogether, at another time, or cut off. That is a unit, a sign, a clock or the end of a sensor's
range more often than physics, and the first thing to look at.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from pianobot_ros.gap.fitting.evidence import open_observables
from pianobot_ros.gap.problem.constants import MOST, NEGLIGIBLE, SMALL, TINY
from pianobot_ros.gap.problem.types import Array
from pianobot_ros.gap.search.study import Study

__all__ = ["at_starts", "cut_off", "out_of_time", "unlike_units"]

UNITS = {
    "degrees and radians": 180.0 / math.pi,
    "turns and radians": 2.0 * math.pi,
    "turns a minute and radians a second": 30.0 / math.pi,
    "kilograms and newtons": 9.80665,
    "steps of a hundred": 1e2,
    "steps of a thousand": 1e3,
    "steps of a million": 1e6,
}
"""Larger over smaller of what units are confused (SI Brochure, 9th edition)."""
LARGE = 5.0
"""Times that no parameter is wrong by without being doubted (prior)."""


def unlike_units(study: Study) -> list[str]:
    """What is to be said of every open series that its nominal prediction explains nine tenths of,
    turned or scaled by more than a parameter may be.
    """
    problem, out = study.problem, []
    for o in open_observables(study, study.nominal):
        own, observable = (problem.obs_of == o) & problem.mask, problem.observables[o]
        if observable.kind != "series":
            continue
        x, y = (v[own] - v[own].mean() for v in (study.nominal, problem.y))
        power = float(x @ x) * float(y @ y)
        if not power or float(x @ y) ** 2 < (1.0 - SMALL) * power:
            continue
        ratio = float(x @ y) / float(x @ x)
        if said := _said(ratio):
            out.append(f"{observable.name} has the shape that the twin predicts, with {said}")
    return out


def out_of_time(study: Study) -> list[str]:
    """What is to be said of every open series most of whose gap is that each block is as the
    nominal twin predicts it somewhat earlier or later.
    """
    problem, out = study.problem, []
    for o in _open_series(study, study.nominal):
        late, left, whole = [], 0.0, TINY
        for c in problem.cells_of(o):
            t = c.t[problem.mask[c.start : c.stop]]
            x, y = (problem.judged(c, v) for v in (study.nominal, problem.y))
            if t.size > 2:
                rate = np.gradient(x, t)
                late.append(-float((y - x) @ rate) / max(float(rate @ rate), TINY))
                left += float(np.sum((y - x + late[-1] * rate) ** 2))
                whole += float(np.sum((y - x) ** 2))
        longest = max(map(abs, late), default=0.0)  # beyond that no slope is a shift
        if left < (1.0 - MOST) * whole and longest < study.fitter.noise.estimates.noises[o].lasts:
            sign = math.copysign(1.0, float(np.median(late)))
            usual, low, high = np.quantile(sign * np.array(late), [0.5, 0.0, 1.0]).tolist()
            out.append(
                f"{problem.observables[o].name} comes {usual:.3g} s"
                f" {'later' if sign > 0.0 else 'earlier'} than the nominal twin predicts it"
                f" ({low:.3g} to {high:.3g} in single blocks; {100 * (1.0 - left / whole):.0f} % of"
                " its gap): check the stamps and filters of it and of what it is predicted from"
            )
    return out


def at_starts(study: Study, prediction: Array) -> list[str]:
    """Of open series most of what a prediction (size,) leaves of which is where blocks begin."""
    problem, found = study.problem, []
    for o in _open_series(study, prediction):
        rows = [problem.judged(c, problem.y - prediction) ** 2 for c in problem.cells_of(o)]
        begun = sum(float(np.sum(x[: math.ceil(SMALL * x.size)])) for x in rows)
        if begun > MOST * sum(float(np.sum(x)) for x in rows):
            found.append(problem.observables[o].name)
    if not found:
        return []
    return [
        f"most of what is left of {', '.join(found)} is in the first tenth of the blocks: does"
        " `simulate` start each from what was measured there?"
    ]


def cut_off(study: Study) -> list[str]:
    """What is to be said of signals that stand at their largest or smallest value far oftener than
    at any other: the end of a sensor's range.
    """
    problem, out = study.problem, []
    for o in _series(study, problem.present):
        own = (problem.obs_of == o) & problem.mask
        values, count = np.unique(problem.y[own], return_counts=True)
        if values.size < 3:
            continue
        least = max(NEGLIGIBLE * float(own.sum()), float(np.max(count[1:-1])) / SMALL)
        ends = [
            f"{x:.4g}" for x, n in ((values[0], count[0]), (values[-1], count[-1])) if n > least
        ]
        if ends:
            out.append(
                f"{problem.observables[o].name} often stands at {' and '.join(ends)}, its furthest"
                " value: if its sensor ends there, make what it does not see NaN, and leave out"
                " what is predicted from that"
            )
    return out


def _open_series(study: Study, prediction: Array) -> list[int]:
    """The series of which a prediction (size,) leaves a gap open, in their order."""
    return _series(study, sorted(open_observables(study, prediction)))


def _series(study: Study, observables: Iterable[int]) -> list[int]:
    """Those of some observables that are no events."""
    return [o for o in observables if study.problem.observables[o].kind == "series"]


def _said(ratio: float) -> str:
    """Of measured over predicted; empty where it may be a parameter's."""
    size = abs(ratio)
    parts = ["the other sign"] if ratio < 0.0 else []
    if max(size, 1.0 / size) > LARGE:
        parts.append(f"{size:{'.3g' if size < 1e3 else '.0f'}} times the size")
    if not parts:
        return ""
    alike = [n for n, r in UNITS.items() if abs(abs(math.log(size)) - math.log(r)) < SMALL]
    how = f" ({' or '.join(alike)} differ so)" if alike else ""
    return f"{' and '.join(parts)}{how}: check its unit and sign before anything else"
