"""A parameter that drifts over the session (a joint that warms up, a battery that runs down):
repeats differ by it.

It would count as scatter and hide in the floor. What the scatter of repeats has along one
parameter's sensitivity, as a smooth function of session time, is no scatter where it is more than
exchanged repeats have: it is taken out of the floor and stays in the gap.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pianobot_ros.gap.floor.repeats import more_than_chance, orders, repeats, standardised
from pianobot_ros.gap.problem.constants import EARLY
from pianobot_ros.gap.problem.problem import Cell, Index, Problem
from pianobot_ros.gap.problem.types import Array

__all__ = ["Drift", "find_drift"]


@dataclass(frozen=True)
class Drift:
    """The part of a flat residual (size,) that comes from `parameter`."""

    parameter: str
    residual: Array


@dataclass(frozen=True)
class _Fit:
    """Regressions of one observable's scatter on the courses of each parameter: explained shares
    (draws, p), the true order first, and the true coefficients (p, 2).
    """

    shares: Array
    coefficients: Array


def find_drift(problem: Problem, residual: Array, jacobian: Array, share: float) -> Drift | None:
    """The parameter whose drift best explains the scatter of repeats; None if none does.

    `residual` (size,) and the prediction's `jacobian` (size, p) are at the refitted parameters. It
    must explain `share` of an observable's scatter.
    """
    if not problem.parameters:
        return None
    jacobian = jacobian[:, : len(problem.parameters)]
    courses, rng = _courses(problem), np.random.default_rng(0)
    fits = [
        f
        for f in (_fit(problem, o, residual, jacobian, courses, rng) for o in problem.present)
        if f is not None
    ]
    if not fits:
        return None
    # of few repeats chance explains much: each observable counts in deviations of its own draws
    strength = np.array([standardised(f.shares.max(1)) for f in fits])
    if not more_than_chance(strength.max(0)):
        return None
    best = fits[int(np.argmax(strength[:, 0]))]
    p = int(np.argmax(best.shares[0]))
    if best.shares[0, p] < share:
        return None
    course = courses @ best.coefficients[p]
    return Drift(problem.parameters[p].name, jacobian[:, p] * course[problem.block_of])


def _courses(problem: Problem) -> Array:
    """Two courses over session time, by block (blocks, 2), zero on average: steady, and settling
    early.
    """
    starts = problem.start_of_block
    x = (starts - starts.min()) / (float(np.ptp(starts)) or 1.0)
    courses = np.column_stack([x, np.exp(-x / EARLY)])
    return np.asarray(courses - courses.mean(0))


def _fit(
    problem: Problem,
    o: int,
    residual: Array,
    jacobian: Array,
    courses: Array,
    rng: np.random.Generator,
) -> _Fit | None:
    """Of one observable; None without repeats. A parameter that is wrong all the time moves repeats
    that are driven differently by different amounts: that is no course, and is taken off first.
    """
    cells = [
        c
        for c in problem.cells
        if c.observable == o and problem.mask[c.start : c.stop].all() and not c.absent
    ]
    along, gram, total = [], 0.0, 0.0
    for members in repeats(problem, cells, residual):
        y, moved = _apart(members, residual, jacobian, courses)
        total += float(np.sum(y**2))
        gram = gram + np.einsum("inpk,inpl->pkl", moved, moved)
        along.append(_exchanged(y, moved, orders(len(members), rng)))
    if not along or total <= 0.0:
        return None
    return _regressed(np.sum(along, axis=0), np.asarray(gram), total)


def _exchanged(y: Array, moved: Array, order: Index) -> Array:
    """Products of exchanged repeats y (m, n) with the columns (m, n, p, 3), by order (draws, p, 3);
    one parameter after the other, since of many repeats there are many pairs.
    """
    own = np.arange(len(y))
    each = [np.tensordot(moved[:, :, p], y, axes=(1, 1)) for p in range(moved.shape[2])]
    return np.stack([pairs[own, :, order].sum(1) for pairs in each], axis=1)


def _apart(
    members: list[Cell], residual: Array, jacobian: Array, courses: Array
) -> tuple[Array, Array]:
    """How far repeats (m) are from their mean: y (m, n), and what each parameter's level and
    courses make of it (m, n, p, 3).
    """
    n = min(c.stop - c.start for c in members)
    y = np.array([residual[c.start : c.start + n] for c in members])
    level = np.column_stack([np.ones(len(courses)), courses])
    moved = np.array([jacobian[c.start : c.start + n, :, None] * level[c.block] for c in members])
    return y - y.mean(0), moved - moved.mean(0)


def _regressed(along: Array, gram: Array, total: float) -> _Fit:
    """From the products of scatter and columns (draws, p, 3), of the columns (p, 3, 3) and of the
    scatter itself: what the courses explain beyond the level.
    """
    level = np.maximum(gram[:, 0, 0], 1e-300)
    left = along[..., 1:] - gram[:, 0, 1:] * (along[..., 0] / level)[..., None]
    own = gram[:, 1:, 1:] - gram[:, 1:, :1] * gram[:, :1, 1:] / level[:, None, None]
    inverse = np.linalg.pinv(own, rcond=1e-9, hermitian=True)
    shares = np.einsum("rpk,pkl,rpl->rp", left, inverse, left) / total
    return _Fit(shares, np.einsum("pkl,pl->pk", inverse, left[0]))
