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

from pianobot_ros.gap.floor.repeats import Repeats, set_apart, unshared_inputs
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
    """Repeats of one observable: their `scatter` (sum of squares), and the block (m,), `start`
    (m,) s and `level` (m,) of each, its residual along a shape. By how much each is moved by the
    level that each of the `groups` has (m, g); by a course, which has as many `slopes` (m, w); and
    by as many `wanders` (m, w), which know nothing of one another.
    """

    scatter: float
    block: Index
    start: Array
    level: Array
    groups: Array
    slopes: Array
    wanders: Array


@dataclass(frozen=True)
class _Course:
    """That of the courses `tried` which explains most of an observable's repeats: logarithm of the
    probability that one of them explains as much by chance, the `share` of all their scatter, which
    course it is and its slopes (w, k).
    """

    log_chance: float
    tried: int
    share: float
    which: int
    slopes: Array


def find_drift(problem: Problem, residual: Array, jacobian: Array, share: float) -> Drift | None:
    """The parameter whose drift best explains the scatter of repeats, of those that make it larger
    nowhere if there are such; elsewhere its part is 0. None if none does.

    `residual` (size,) and the prediction's `jacobian` (size, p) are at the refitted parameters. It
    must explain `share` of an observable's scatter, and chance must not: an analysis of variance.
    Of so many courses, parameters and observables some explain much by chance (Bonferroni's bound).
    """
    jacobian = jacobian[:, : len(problem.parameters)]
    groups = {o: set_apart(problem, o, residual) for o in problem.present}
    courses = _courses(problem)
    found = [
        (course, p, some)
        for own in groups.values()
        if own
        for p, known in enumerate(_by_parameter(problem, own, residual, jacobian))
        for some in courses
        if (course := _explained(known, some.courses)) is not None
    ]
    drifts = []
    for best, p, some in sorted(_no_chance(found, share), key=lambda x: x[0].log_chance):
        terms = some.courses[best.which]
        moved = jacobian[:, p] * ((terms - terms.mean(0)) @ best.slopes[0])[problem.block_of]
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
    tried = [
        (course, x, some)
        for x in told
        for some in courses
        if (course := _explained(x.levels, some.courses))
    ]
    found = _no_chance(tried, share)
    if not found:
        return residual, {}
    _, leader, first = min(found, key=lambda x: x[0].log_chance)
    level = np.full(len(problem.blocks), np.nan)
    level[leader.levels.block] = leader.levels.level
    for x in told:
        if x is not leader and np.isfinite(level[x.levels.block]).all():
            along = np.nan_to_num(level)[None, :, None]
            course = _explained(x.levels, along)
            if course and course.share >= share and course.log_chance <= np.log(CHANCE):
                found.append((course, x, replace(first, courses=along)))
    out, names = residual.copy(), dict[str, str]()
    for x in told:
        own = [(course, some) for course, y, some in found if y is x]
        if own:
            course, some = min(own, key=lambda c: c[0].log_chance)
            x.take(out, some.courses[course.which], course.slopes)
            names[problem.observables[x.observable].name] = some.attribute
    return out, names


@dataclass(frozen=True)
class _ByShape:
    """Repeats of one observable along the shape (n,) in which each of its `groups` differs most."""

    observable: int
    groups: Sequence[Repeats]
    shapes: Sequence[Array]
    levels: _Levels

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
    level = np.concatenate([apart @ s for apart, s in zip(each, shapes, strict=True)])
    members = _members(groups)
    # shapes have no sign
    wanders = members * np.sqrt(level**2 @ members / members.sum(0))
    known = _Levels(*_repeated(problem, groups, each), level, members, members, wanders)
    return _ByShape(o, groups, shapes, known)


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
    repeats, but for those that say how a block is driven: that is the same for repeats. So is the
    mean of an input, unless it is no command.
    """
    starts = problem.start_of_block
    x = (starts - starts.min()) / (float(np.ptp(starts)) or 1.0)
    both = np.column_stack([x, np.exp(-x / EARLY)])
    steps = np.asarray(starts >= np.sort(starts)[2:-1, None], float)
    session = (both[None], both.T[..., None], np.asarray(steps, float)[..., None])
    return (*map(_Tried, session), *_beside(problem))


def _beside(problem: Problem) -> Iterator[_Tried]:
    """Attributes, and means of inputs, that are known of all blocks and differ between repeats, as
    courses; but for what is the time of the session under another name.
    """
    condition, starts = problem.condition_of_block, problem.start_of_block
    each = [{k: v for k, v in b.attributes.items() if k not in b.units} for b in problem.blocks]
    own = {n: np.array([float(x[n]) for x in each]) for n in set.intersection(*map(set, each))}
    for name, x in sorted((unshared_inputs(problem) | own).items()):
        alike = (x[condition == k] for k in np.unique(condition))
        differs = any(np.ptp(own) > ROUNDING * np.ptp(x) for own in alike)
        if not (differs and np.isfinite(x).all()):
            continue
        if 1.0 - np.corrcoef(x, starts)[0, 1] ** 2 > NEGLIGIBLE:
            yield _Tried(((x - x.mean()) / np.ptp(x))[None, :, None], name)


def _by_parameter(
    problem: Problem, groups: Sequence[Repeats], residual: Array, jacobian: Array
) -> Iterator[_Levels]:
    """Repeats of one observable along the sensitivity to each parameter, which moves a repeat by
    the norm of its own. Levels are free since a parameter that is wrong all the time moves repeats
    that are driven differently by different amounts.
    """
    each = [g.apart(residual) for g in groups]
    level, size = [], []
    for g, apart in zip(groups, each, strict=True):
        for at, row in zip(g.at, apart, strict=True):
            own = jacobian[at]
            size.append(np.linalg.norm(own, axis=0))
            level.append(row @ own / np.maximum(size[-1], TINY))
    of, members = _repeated(problem, groups, each), _members(groups)
    for along, moved in zip(np.transpose(level), np.transpose(size)[..., None], strict=True):
        yield _Levels(*of, along, members * moved, moved, moved)


def _repeated(
    problem: Problem, groups: Sequence[Repeats], each: Sequence[Array]
) -> tuple[float, Index, Array]:
    """Scatter (sum of squares) of repeats, which are set apart by `each` (m, n) of their groups;
    block (m,) and start (m,) s of each.
    """
    block = np.array([c.block for g in groups for c in g.cells])
    return sum(float(np.sum(x**2)) for x in each), block, problem.start_of_block[block]


def _members(groups: Sequence[Repeats]) -> Array:
    """Which repeats are of which group, (m, g) of 0 and 1."""
    return np.repeat(np.eye(len(groups)), [len(g.cells) for g in groups], axis=0)


def _explained(known: _Levels, courses: Array) -> _Course | None:
    """Analysis of variance of levels on one of some courses (tried, blocks, k) beside those of
    their groups and their wanders; None where nothing tells one from a level. It takes the rest for
    Gaussian, so a level that is far from nearly all others pulls no harder than those (Huber 1964).
    """
    groups, length = known.groups, np.linalg.norm(known.groups, axis=0)
    if not (len(courses) and length.any()):
        return None
    scale = float(np.linalg.norm(groups))
    groups = groups[:, length > 0.0] / length[length > 0.0]
    left = without_far(known.level - groups @ (groups.T @ known.level))
    left = left - groups @ (groups.T @ left)
    moved = np.einsum("tmk,mw->tmwk", courses[:, known.block], known.slopes)
    moved = moved.reshape(*moved.shape[:2], -1)
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
        rest = left_beside_wander(left, course, groups, known.wanders, known.start)
        chance = _log_chance(rest, freedom, rank)
    slopes = vt[most].T @ (along[most] / np.where(keep[most], s[most], 1.0))
    slopes = slopes.reshape(known.slopes.shape[1], -1)
    return _Course(chance, int(keep.any(1).sum()), explained / known.scatter, most, slopes)


def _log_chance(rest: float, freedom: float, rank: int) -> float:
    """Logarithm of the probability that chance leaves no more than the share `rest` of squares: F's
    distribution by the beta distribution of what is left.
    """
    with np.errstate(divide="ignore"):
        return float(np.log(betainc(0.5 * freedom, 0.5 * rank, rest)))
