"""A parameter that drifts over the session (a joint that warms up, a battery that runs down):
repeats differ by it.

It would count as scatter and hide in the floor. What the scatter of repeats has along one
parameter's sensitivity, as a smooth
function of session time that is fitted to some conditions and predicts the others, is no scatter:
it is taken out of the floor and stays in the gap.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pianobot_ros.gap.floor.repeats import repeats
from pianobot_ros.gap.problem.constants import DRIFT_REPEATS, DRIFT_SHARE, EARLY
from pianobot_ros.gap.problem.problem import Problem
from pianobot_ros.gap.problem.types import Array


@dataclass(frozen=True)
class Drift:
    """The part of a flat residual (size,) that comes from `parameter`."""

    parameter: str
    residual: Array


def find_drift(problem: Problem, residual: Array, jacobian: Array) -> Drift | None:
    """The parameter whose drift best explains the scatter of repeats; None if none does.

    `residual` (size,) and the prediction's `jacobian` (size, p) are at the refitted parameters.
    """
    courses = _courses(problem)
    table = _scatter(problem, residual, jacobian[:, : len(problem.parameters)], courses)
    if table is None:
        return None
    y, columns, group, observable, blocks = table
    least = DRIFT_SHARE / np.sqrt(blocks)
    best: tuple[float, int] = (least, -1)
    for p in range(columns.shape[1]):
        for o in np.unique(observable):
            own = observable == o
            best = max(best, (_predicted(y[own], columns[own, p], group[own]), p))
    if best[1] < 0:
        return None
    p = best[1]
    course = courses @ _solve(columns[:, p], y)
    return Drift(problem.parameters[p].name, jacobian[:, p] * course[problem.block_of])


def _courses(problem: Problem) -> Array:
    """Two courses over session time, by block (blocks, 2), zero on average: steady, and settling
    early. What is constant is no drift, however repeats differ in their sensitivity to it.
    """
    starts = problem.start_of_block
    x = (starts - starts.min()) / (float(np.ptp(starts)) or 1.0)
    courses = np.column_stack([x, np.exp(-x / EARLY)])
    return np.asarray(courses - courses.mean(0))


def _scatter(
    problem: Problem, residual: Array, jacobian: Array, courses: Array
) -> tuple[Array, Array, Array, Array, int] | None:
    """Deviations of repeats from their mean, in units of their observable's scatter: y (n,), its
    sensitivity to each parameter's `courses` (n, p, 2), group (n,), observable (n,), and the number
    of repeats.
    """
    parts: list[tuple[Array, Array, int, int]] = []
    count = 0
    for o in problem.present:
        cells = [
            c
            for c in problem.cells
            if c.observable == o and problem.mask[c.start : c.stop].all() and not c.absent
        ]
        rows: list[tuple[Array, Array, int]] = []
        for k, members in enumerate(repeats(problem, cells, residual)):
            n = min(c.stop - c.start for c in members)
            y = np.array([residual[c.start : c.start + n] for c in members])
            moved = np.array(
                [jacobian[c.start : c.start + n, :, None] * courses[c.block] for c in members]
            )
            rows.append((y - y.mean(0), moved - moved.mean(0), k))
        size = (
            float(np.sqrt(np.mean(np.concatenate([np.ravel(y**2) for y, _, _ in rows]))))
            if rows
            else 0.0
        )
        if size > 0:
            parts += [
                (y.ravel() / size, m.reshape(-1, *m.shape[2:]) / size, k, o) for y, m, k in rows
            ]
            count = max(count, sum(len(y) for y, _, _ in rows))
    if count < DRIFT_REPEATS or len({k for _, _, k, _ in parts}) < 2 or not jacobian.shape[1]:
        return None
    y = np.concatenate([p[0] for p in parts])
    group, observable = (np.concatenate([np.full(p[0].size, p[i]) for p in parts]) for i in (2, 3))
    return y, np.concatenate([p[1] for p in parts]), group, observable, count


def _solve(columns: Array, y: Array) -> Array:
    """Least squares of y (n,) in the columns (n, 2)."""
    return np.asarray(np.linalg.lstsq(columns, y, rcond=None)[0])


def _predicted(y: Array, columns: Array, group: Array) -> float:
    """Share of y (n,) that the columns (n, 2) predict in groups they were not fitted to."""
    left = 0.0
    for fold in (0, 1):
        out = group % 2 == fold
        if not out.any() or out.all():
            return 0.0
        left += float(np.sum((y[out] - columns[out] @ _solve(columns[~out], y[~out])) ** 2))
    return 1.0 - left / max(float(np.sum(y**2)), 1e-300)
