"""What a signal looks like beside its prediction: of the same shape, but turned, or of another
size altogether. That is a unit or a sign more often than physics, and the first thing to look at.
"""

from __future__ import annotations

import math

from pianobot_ros.gap.fitting.evidence import open_observables
from pianobot_ros.gap.problem.constants import SMALL
from pianobot_ros.gap.search.study import Study

__all__ = ["unlike_units"]

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
