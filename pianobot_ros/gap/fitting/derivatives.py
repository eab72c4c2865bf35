"""Derivatives of a prediction by differences, where a twin may fail on one side and signals may
jump.

A signal that jumps when its moment moves (an impact, a switch) has no derivative there: over a
short step the jump passes one sample, whose difference outweighs all others, or none. So where few
samples hold most of a difference it is taken to both sides, and of two that disagree the smaller
counts, as of slopes beside a shock (minmod; Roe 1986).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from pianobot_ros.gap.fitting.space import Space
from pianobot_ros.gap.problem.constants import DISAGREE, LARGEST, MOST, NEGLIGIBLE
from pianobot_ros.gap.problem.problem import Index, Problem, Request
from pianobot_ros.gap.problem.types import Array


def differences(
    problem: Problem,
    space: Space,
    v: Array,
    base: Array,
    effects: tuple[str, ...],
    columns: Iterable[int],
    step: float,
) -> Array:
    """Differences (size, p) of the flat prediction for `columns` (others are 0) about the
    parameters `v` (p,) and the prediction `base` (size,) there: forward over a `step`, else
    backward.
    """
    steps = {}
    for j in columns:
        h = step if v[j] + step <= space.high[j] else -step
        steps[j] = 0.5 * (space.high[j] - v[j]) if v[j] + h < space.low[j] else h
    found = _taken(problem, space, v, base, effects, steps)
    series = _series(problem)
    back = {
        j: -h
        for j, h in steps.items()
        if space.low[j] <= v[j] - h <= space.high[j]
        and (j not in found or _jumps(found[j], series))
    }
    other = _taken(problem, space, v, base, effects, back)
    out = np.zeros((problem.size, len(space)))
    for j in steps:
        one = found.get(j, other.get(j))
        if one is not None:
            out[:, j] = _smoother(one, other.get(j, one))
    return out


def _taken(
    problem: Problem,
    space: Space,
    v: Array,
    base: Array,
    effects: tuple[str, ...],
    steps: Mapping[int, float],
) -> dict[int, Array]:
    """Differences (size,) over each column's step, where there is one and the twin can make it: a
    loop that the step made unstable tells of no derivative.
    """
    requests: list[Request] = []
    for j, h in steps.items():
        w = v.copy()
        w[j] += h
        requests.append((space.decode(w), effects))
    results = zip(steps.items(), problem.predict_many(requests), strict=True)
    found = {j: (x - base) / h for (j, h), x in results if h and not isinstance(x, Exception)}
    return {j: x for j, x in found.items() if not np.any(np.abs(x) > LARGEST)}


def _series(problem: Problem) -> list[Index]:
    """Indices (n,) of the judged samples of each series."""
    return [
        np.flatnonzero((problem.obs_of == o) & problem.mask)
        for o in problem.present
        if problem.observables[o].kind == "series"
    ]


def _jumps(difference: Array, series: Iterable[Index]) -> bool:
    """Whether few samples of a series hold most of a difference's (size,) power there."""
    for own in series:
        power = difference[own] ** 2
        few = int(NEGLIGIBLE * power.size)
        if few and np.partition(power, -few)[-few:].sum() > MOST * power.sum():
            return True
    return False


def _smoother(one: Array, other: Array) -> Array:
    """The first of two differences (size,), where they disagree the smaller."""
    larger = np.maximum(np.abs(one), np.abs(other))
    smaller = np.where(np.abs(one) <= np.abs(other), one, other)
    return np.where(np.abs(one - other) > DISAGREE * larger, smaller, one)
