"""A parameter that drifts over the session (a joint that warms up, a battery that runs down) or
changes once in it (a mount that gives way): repeats differ by it.

It would count as scatter and hide in the floor. What the scatter of repeats has along one
parameter's sensitivity, as a course over session time, is no scatter where it is more than chance
makes of as many repeats: it is taken out of the floor and stays in the gap.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

from pianobot_ros.gap.floor.repeats import repeats
from pianobot_ros.gap.problem.constants import CHANCE, EARLY
from pianobot_ros.gap.problem.problem import Index, Problem
from pianobot_ros.gap.problem.types import Array

__all__ = ["Drift", "find_drift"]


@dataclass(frozen=True)
class Drift:
    """The part of a flat residual (size,) that comes from `parameter`."""

    parameter: str
    residual: Array


@dataclass(frozen=True)
class _Repeats:
    """Repeats of one observable: their `scatter` (sum of squares), the block (m,), group (m,) and
    `level` (m, p) of each: its residual along each parameter's sensitivity, whose norm is `size`
    (m, p).
    """

    scatter: float
    block: Index
    group: Index
    level: Array
    size: Array


@dataclass(frozen=True)
class _Course:
    """That of the courses `tried` for a parameter which explains most of an observable's repeats:
    logarithm of the probability that one of them explains as much by chance, the `share` of all
    their scatter, and the parameter's `course` (blocks,), 0 on average.
    """

    parameter: int
    log_chance: float
    tried: int
    share: float
    course: Array


def find_drift(problem: Problem, residual: Array, jacobian: Array, share: float) -> Drift | None:
    """The parameter whose drift best explains the scatter of repeats; None if none does.

    `residual` (size,) and the prediction's `jacobian` (size, p) are at the refitted parameters. It
    must explain `share` of an observable's scatter, and chance must not: an analysis of variance.
    Of so many courses, parameters and observables some explain much by chance (Bonferroni's bound).
    """
    jacobian = jacobian[:, : len(problem.parameters)]
    courses = (_settling(problem), _steps(problem))
    told = (_repeats(problem, o, residual, jacobian) for o in problem.present)
    found = [
        course
        for known in told
        if known is not None
        for p in range(jacobian.shape[1])
        for some in courses
        if (course := _regressed(known, p, some)) is not None
    ]
    enough = [x for x in found if x.share >= share]
    best = min(enough, key=lambda x: x.log_chance, default=None)
    tried = sum(x.tried for x in found)
    if best is None or best.log_chance + np.log(tried) > np.log(CHANCE):
        return None
    along = jacobian[:, best.parameter] * best.course[problem.block_of]
    return Drift(problem.parameters[best.parameter].name, along)


def _settling(problem: Problem) -> Array:
    """Two courses over session time, by block, as one (1, blocks, 2): steady, and settling
    early.
    """
    starts = problem.start_of_block
    x = (starts - starts.min()) / (float(np.ptp(starts)) or 1.0)
    return np.column_stack([x, np.exp(-x / EARLY)])[None]


def _steps(problem: Problem) -> Array:
    """A step between any two blocks of which two at least are on either side (steps, blocks, 1)."""
    starts = problem.start_of_block
    return np.asarray(1.0 * (starts >= np.sort(starts)[2:-1, None])[..., None])


def _repeats(problem: Problem, o: int, residual: Array, jacobian: Array) -> _Repeats | None:
    """Of one observable; None without any."""
    cells = [
        c
        for c in problem.cells
        if c.observable == o and problem.mask[c.start : c.stop].all() and not c.absent
    ]
    groups = repeats(problem, cells, residual)
    scatter, level, size = 0.0, [], []
    for members in groups:
        n = min(c.stop - c.start for c in members)
        apart = np.array([residual[c.start : c.start + n] for c in members])
        apart = apart - apart.mean(0)
        scatter += float(np.sum(apart**2))
        for c, row in zip(members, apart, strict=True):
            own = jacobian[c.start : c.start + n]
            size.append(np.linalg.norm(own, axis=0))
            level.append(row @ own / np.maximum(size[-1], 1e-300))
    if scatter <= 0.0:
        return None
    label = np.repeat(np.arange(len(groups)), [len(g) for g in groups])
    block = np.array([c.block for g in groups for c in g])
    return _Repeats(scatter, block, label, np.array(level), np.array(size))


def _regressed(known: _Repeats, parameter: int, courses: Array) -> _Course | None:
    """On that of some courses (tried, blocks, k) which explains most, beside a level of each group
    of repeats; None where nothing tells one from a level. Levels are free since a parameter that is
    wrong all the time moves repeats that are driven differently by different amounts.
    """
    size = known.size[:, parameter]
    if not (len(courses) and size.any()):
        return None
    groups = (known.group[:, None] == np.unique(known.group)) * size[:, None]
    length = np.linalg.norm(groups, axis=0)
    groups = groups[:, length > 0.0] / length[length > 0.0]
    left = known.level[:, parameter]
    left = left - groups @ (groups.T @ left)
    moved = size[:, None] * courses[:, known.block]  # (tried, m, k)
    moved = moved - groups @ (groups.T @ moved)
    u, s, vt = np.linalg.svd(moved, full_matrices=False)
    keep = s > 1e-6 * np.linalg.norm(size)
    along = np.where(keep, np.einsum("tmk,m->tk", u, left), 0.0)
    most = int(np.argmax(np.sum(along**2, axis=1)))
    whole, explained = float(left @ left), float(along[most] @ along[most])
    rank = int(keep[most].sum())
    freedom = left.size - groups.shape[1] - rank
    if rank == 0 or freedom < 1 or whole <= 0.0:
        return None
    rest = max(whole - explained, 1e-12 * whole)
    with np.errstate(divide="ignore"):
        chance = float(np.log(fdtrc(rank, freedom, explained / rank / (rest / freedom))))
    slope = vt[most].T @ (along[most] / np.where(keep[most], s[most], 1.0))
    course = (courses[most] - courses[most].mean(0)) @ slope
    return _Course(parameter, chance, int(keep.any(1).sum()), explained / known.scatter, course)
