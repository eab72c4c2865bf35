"""A parameter that drifts over the session (a joint that warms up, a battery that runs down) or
changes once in it (a mount that gives way): repeats differ by it.

It would count as scatter and hide in the floor. What the scatter of repeats has along one
parameter's sensitivity, or along the shape in which they differ most, as a course over session
time, is no scatter where it is more than chance makes of as many repeats: it is taken out of the
floor and stays in the gap. The same holds for what goes with an attribute that differs between
repeats (a temperature): what is known of a block is no scatter.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from scipy.special import betainc

from pianobot_ros.gap.floor.repeats import Repeats, set_apart
from pianobot_ros.gap.floor.session.wander import left_beside_wander, without_far
from pianobot_ros.gap.problem.constants import CHANCE, EARLY, NEGLIGIBLE, ROUNDING, SMALL, TINY
from pianobot_ros.gap.problem.problem import Index, Problem
from pianobot_ros.gap.problem.types import Array

Of = TypeVar("Of")


@dataclass(frozen=True)
class Drift:
    """The part of a flat residual (size,) that comes from `parameter`, which goes with an
    `attribute`, or with the time of the session where there is none.
    """

    parameter: str
    attribute: str
    residual: Array


@dataclass(frozen=True)
class _Tried:
    """Courses by block (tried, blocks, k), each of k terms: of an `attribute`, or over session
    time where there is none.
    """

    courses: Array
    attribute: str = ""


@dataclass(frozen=True)
class _Levels:
    """Repeats of one observable: their `scatter` (sum of squares), the block (m,), `start` (m,) s
    and `level` (m, p) of each: its residual along each parameter's sensitivity, whose norm is
    `size` (m, p); and which are `members` of each group, (m, g) of 0 and 1.
    """

    scatter: float
    block: Index
    start: Array
    members: Array
    level: Array
    size: Array


@dataclass(frozen=True)
class _Course:
    """That of the courses `tried` which explains most of an observable's repeats: logarithm of the
    probability that one of them explains as much by chance, the `share` of all their scatter, which
    course it is and its size, by group of repeats where each has its own.
    """

    log_chance: float
    tried: int
    share: float
    which: int
    slope: Array


def find_drift(problem: Problem, residual: Array, jacobian: Array, share: float) -> Drift | None:
    """The parameter whose drift best explains the scatter of repeats, of those that make it larger
    nowhere if there are such; elsewhere its part is 0. None if none does.

    `residual` (size,) and the prediction's `jacobian` (size, p) are at the refitted parameters. It
    must explain `share` of an observable's scatter, and chance must not: an analysis of variance.
    Of so many courses, parameters and observables some explain much by chance (Bonferroni's bound).
    """
    jacobian = jacobian[:, : len(problem.parameters)]
    groups = {o: set_apart(problem, o, residual) for o in problem.present}
    repeated = (_levels(problem, own, residual, jacobian) for own in groups.values())
    courses = _courses(problem)
    found = [
        (course, p, some)
        for known in repeated
        if known is not None
        for p in range(jacobian.shape[1])
        for some in courses
        if (course := _of_parameter(known, p, some.courses)) is not None
    ]
    drifts = []
    for best, p, some in sorted(_no_chance(found, share), key=lambda x: x[0].log_chance):
        terms = some.courses[best.which]
        moved = jacobian[:, p] * ((terms - terms.mean(0)) @ best.slope)[problem.block_of]
        drift = Drift(problem.parameters[p].name, some.attribute, moved)
        drifts.append((_more_apart(groups, residual, moved), drift))
    if not drifts:
        return None
    wrong, drift = next((x for x in drifts if not x[0]), drifts[0])
    return replace(drift, residual=np.where(np.isin(problem.obs_of, wrong), 0.0, drift.residual))


def _more_apart(
    groups: Mapping[int, Sequence[Repeats]], residual: Array, moved: Array
) -> list[int]:
    """The observables of whose `residual` (size,) repeats, in `groups` by observable, are further
    apart, by what is not small, without what a drift has `moved` (size,). What drifts moves all
    that hangs on it: another parameter's drift looks like its own in one of them alone.
    """
    wrong = []
    for o, own in groups.items():
        before, after = (
            sum(float(np.sum(g.apart(x) ** 2)) for g in own) for x in (residual, residual - moved)
        )
        if after > (1.0 + SMALL) * before:
            wrong.append(o)
    return wrong


def without_courses(
    problem: Problem, residual: Array, share: float
) -> tuple[Array, dict[str, str]]:
    """A residual (size,) without the courses that repeats take along the shape in which they differ
    most, and by name of the observables where they do the attribute that they go with, which is
    empty where that is the time of the session. That shape may be no parameter's: dry
    friction that falls, where none is a parameter. It knows nothing of the order of the repeats, so
    the test is that of :func:`find_drift`; each condition has a shape, and a size, of its own. Once
    one observable changes, what goes with it from block to block in others does.
    """
    told = [known for o in problem.present if (known := _by_shape(problem, o, residual))]
    courses = _courses(problem)
    tried = [(course, x, some) for x in told for some in courses if (course := x.on(some.courses))]
    found = _no_chance(tried, share)
    if not found:
        return residual, {}
    _, leader, first = min(found, key=lambda x: x[0].log_chance)
    level = np.full(len(problem.blocks), np.nan)
    level[leader.levels.block] = leader.levels.level[:, 0]
    for x in told:
        if x is not leader and np.isfinite(level[x.levels.block]).all():
            along = np.nan_to_num(level)[None, :, None]
            course = x.on(along)
            if course and course.share >= share and course.log_chance <= np.log(CHANCE):
                found.append((course, x, replace(first, courses=along)))
    out, names = residual.copy(), dict[str, str]()
    for x in told:
        own = [(course, some) for course, y, some in found if y is x]
        if own:
            course, some = min(own, key=lambda c: c[0].log_chance)
            x.take(out, some.courses[course.which], course.slope)
            names[problem.observables[x.observable].name] = some.attribute
    return out, names


@dataclass(frozen=True)
class _ByShape:
    """Repeats of one observable along the shape (n,) in which each of its `groups` differs most."""

    observable: int
    groups: Sequence[Repeats]
    shapes: Sequence[Array]
    levels: _Levels

    def on(self, courses: Array) -> _Course | None:
        """Which of some courses (tried, blocks, k) explains most, each group with its own slope."""
        known = self.levels
        groups = known.members
        moved = np.einsum("tmk,mg->tmgk", courses[:, known.block], groups)
        count, k = groups.shape[1], courses.shape[2]
        flat = moved.reshape(len(courses), known.block.size, count * k)
        level = known.level[:, 0]
        sizes = groups * np.sqrt(level**2 @ groups / groups.sum(0))  # their shapes have no sign
        found = _explained(known, level, groups, flat, sizes)
        return None if found is None else replace(found, slope=found.slope.reshape(count, k))

    def take(self, out: Array, course: Array, slopes: Array) -> None:
        """Take a course (blocks, k) with its slopes (groups, k) out of a residual (size,).

        The shape is that of the repeats themselves, noise and all, so the course takes its part of
        the noise of every sample along: what is left of a group is as much larger as it has fewer
        degrees of freedom. Of a group to which none is left nothing is taken.
        """
        for g, shape, slope in zip(self.groups, self.shapes, slopes, strict=True):
            own = course[[c.block for c in g.cells]]
            own = own - own.mean(0)
            free, rank = len(g.cells) - 1, int(np.linalg.matrix_rank(own))
            if free <= rank:
                continue
            rows = out[g.at] - np.outer(own @ slope, shape)
            mean = rows.mean(0)
            for at, row in zip(g.at, rows, strict=True):
                out[at] = mean + np.sqrt(free / (free - rank)) * (row - mean)


def _by_shape(problem: Problem, o: int, residual: Array) -> _ByShape | None:
    """Of one observable; None without repeats."""
    groups = set_apart(problem, o, residual)
    if not groups:
        return None
    each = [g.apart(residual) for g in groups]
    shapes = [np.linalg.svd(apart, full_matrices=False)[2][0] for apart in each]
    level = np.concatenate([apart @ s for apart, s in zip(each, shapes, strict=True)])[:, None]
    return _ByShape(
        o, groups, shapes, _labelled(problem, groups, each, level, np.ones(level.shape))
    )


def _no_chance(
    found: Sequence[tuple[_Course, Of, _Tried]], share: float
) -> list[tuple[_Course, Of, _Tried]]:
    """Those that explain a `share` of an observable's scatter and that chance seldom brings, of so
    many courses (Bonferroni).
    """
    least = float(np.log(CHANCE) - np.log(max(sum(x.tried for x, *_ in found), 1)))
    return [x for x in found if x[0].share >= share and x[0].log_chance <= least]


def _courses(problem: Problem) -> tuple[_Tried, ...]:
    """What is tried over session time: steady and settling early together, each alone (of few
    repeats nothing would be left beside both), and a step between any two blocks of which two at
    least are on either side. And every attribute that is known of all blocks and differs between
    repeats, but for those that say how a block is driven: that is the same for repeats.
    """
    starts = problem.start_of_block
    x = (starts - starts.min()) / (float(np.ptp(starts)) or 1.0)
    both = np.column_stack([x, np.exp(-x / EARLY)])
    steps = np.asarray(starts >= np.sort(starts)[2:-1, None], float)
    session = (both[None], both.T[..., None], np.asarray(steps, float)[..., None])
    return (*map(_Tried, session), *_attributes(problem))


def _attributes(problem: Problem) -> Iterator[_Tried]:
    """Attributes that are known of all blocks and differ between repeats, as courses; but for what
    is the time of the session under another name.
    """
    condition, starts = problem.condition_of_block, problem.start_of_block
    for name in sorted(
        set.intersection(*(set(b.attributes) - set(b.units) for b in problem.blocks))
    ):
        x = np.array([float(b.attributes[name]) for b in problem.blocks])
        alike = (x[condition == k] for k in np.unique(condition))
        differs = any(np.ptp(own) > ROUNDING * np.ptp(x) for own in alike)
        if differs and np.isfinite(x).all() and _beside(x, starts) > NEGLIGIBLE:
            yield _Tried(((x - x.mean()) / np.ptp(x))[None, :, None], name)


def _beside(x: Array, other: Array) -> float:
    """Share of the variance of x (n,) that is none of a line in another quantity (n,)."""
    return float(1.0 - np.corrcoef(x, other)[0, 1] ** 2)


def _levels(
    problem: Problem, groups: Sequence[Repeats], residual: Array, jacobian: Array
) -> _Levels | None:
    """Of one observable's repeats, along each parameter's sensitivity; None without any."""
    if not groups:
        return None
    each = [g.apart(residual) for g in groups]
    level, size = [], []
    for g, apart in zip(groups, each, strict=True):
        for at, row in zip(g.at, apart, strict=True):
            own = jacobian[at]
            size.append(np.linalg.norm(own, axis=0))
            level.append(row @ own / np.maximum(size[-1], TINY))
    return _labelled(problem, groups, each, np.array(level), np.array(size))


def _labelled(
    problem: Problem, groups: Sequence[Repeats], each: Sequence[Array], level: Array, size: Array
) -> _Levels:
    """Levels with what they are of: groups of repeats, and what sets apart `each` (m, n)."""
    members = np.repeat(np.eye(len(groups)), [len(g.cells) for g in groups], axis=0)
    block = np.array([c.block for g in groups for c in g.cells])
    scatter = sum(float(np.sum(apart**2)) for apart in each)
    return _Levels(scatter, block, problem.start_of_block[block], members, level, size)


def _of_parameter(known: _Levels, parameter: int, courses: Array) -> _Course | None:
    """That of some courses (tried, blocks, k) which explains most along a parameter's sensitivity.
    Levels are free since a parameter that is wrong all the time moves repeats that are driven
    differently by different amounts.
    """
    size = known.size[:, parameter]
    groups = known.members * size[:, None]
    moved = size[:, None] * courses[:, known.block]  # (tried, m, k)
    return _explained(known, known.level[:, parameter], groups, moved, size[:, None])


def _explained(
    known: _Levels, left: Array, groups: Array, moved: Array, sizes: Array
) -> _Course | None:
    """Analysis of variance of levels (m,) on one of `moved` (tried, m, k) beside the `groups`' own
    levels (m, g) and wanders that move each by their `sizes` (m, w); None where nothing tells one
    from a level. It takes the rest for Gaussian, so a level that is far from nearly all others
    pulls no harder than those (Huber 1964).
    """
    length = np.linalg.norm(groups, axis=0)
    if not (len(moved) and length.any()):
        return None
    scale = float(np.linalg.norm(groups))
    groups = groups[:, length > 0.0] / length[length > 0.0]
    left = without_far(left - groups @ (groups.T @ left))
    left = left - groups @ (groups.T @ left)
    moved = moved - groups @ (groups.T @ moved)
    u, s, vt = np.linalg.svd(moved, full_matrices=False)
    keep = s > ROUNDING * scale
    along = np.where(keep, np.einsum("tmk,m->tk", u, left), 0.0)
    most = int(np.argmax(np.sum(along**2, axis=1)))
    whole, explained = float(left @ left), float(along[most] @ along[most])
    rank = int(keep[most].sum())
    freedom = left.size - groups.shape[1] - rank
    if rank == 0 or freedom < 1 or whole <= 0.0:
        return None
    rest = max(1.0 - explained / whole, float(np.finfo(float).eps))
    chance = _log_chance(rest, freedom, rank)
    if chance <= np.log(CHANCE):
        course = u[most][:, keep[most]]
        rest = left_beside_wander(left, course, groups, sizes, known.start)
        chance = _log_chance(rest, freedom, rank)
    slope = vt[most].T @ (along[most] / np.where(keep[most], s[most], 1.0))
    return _Course(chance, int(keep.any(1).sum()), explained / known.scatter, most, slope)


def _log_chance(rest: float, freedom: float, rank: int) -> float:
    """Logarithm of the probability that chance leaves no more than the share `rest` of squares: F's
    distribution by the beta distribution of what is left.
    """
    with np.errstate(divide="ignore"):
        return float(np.log(betainc(0.5 * freedom, 0.5 * rank, rest)))
