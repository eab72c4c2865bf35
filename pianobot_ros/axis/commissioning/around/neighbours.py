"""Effort that the acceleration of neighbouring joints draws, where no model of the robot says it.

Two neighbours of a serial arm share inertia: I + c cos(angle between their links). Its constant and
its sine and cosine are fitted by regression beside inertia, friction and gravity, and count only if
what is held out is predicted much better with them, and than with the same motions at other times:
joints that move at the same rates explain each other's leftovers with any phase. Joints whose angle
this one's own motion tells (one command for all) are not asked.

Joints further away draw as well, by laws that hang on the robot's geometry. Near the poses of a
log they are a sum over the joints, of accelerations and of sines and cosines of angles (the first
order in each joint's way from the poses' middle). That sum counts by the same test, beyond what the
neighbours say, on poses that are each asked once: those of a task that is done again and again pass
a held-out test by their repeats. Where the others' motion tells the joint's own acceleration, as in
a gait, none is asked. It is asked of measured efforts, since
a following error is as much the loop's, and not of what shall be known of other logs, since it
holds for these poses only.

What is a neighbour's and what the joint's own inertia hangs on how both happened to move: with
coefficients of each log's own, two logs of one machine have different inertias, as if something
had been added. So of a joint with a reference they are that one's, and only what is drawn beyond
them is looked for.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pianobot_ros.axis.commissioning.around.arm import first_visits, target
from pianobot_ros.axis.commissioning.around.other_joints import moves, told
from pianobot_ros.axis.commissioning.regression import (
    HELPS,
    HELPS_ONE,
    INFLATED,
    design,
    held_out,
    inflation,
    of_twist,
)
from pianobot_ros.axis.signals.cleaning import Clean, counted
from pianobot_ros.axis.signals.filtering import derivative
from pianobot_ros.gap.problem.types import Array

__all__ = ["with_neighbours"]

FEWEST = 400
"""Samples without which neighbours are not looked at."""
SHIFTS = (0.0, 0.25, 0.5, 0.75)
"""Shares of a log by which neighbours' motions are shifted, to see what any phase explains."""
RIDGE = 1e-6
"""Of the mean square of each regressor (numerical). More decides what the data hardly tell, what is
a neighbour's and what is the joint's own: 1e-3 took a third off a shoulder's inertia."""


def with_neighbours(
    logs: Sequence[Clean], reference: Clean | None = None, *, anywhere: bool = False
) -> tuple[list[Clean], str]:
    """The logs with what neighbouring joints' accelerations draw of the effort, or what joints
    `anywhere` in the arm do, or as they are; and what there is to say of it. What they drew in a
    `reference` is known.
    """
    names = logs[0].log.joints
    if all(c.coupling is not None for c in logs):
        return _looked_for(logs, reference, [_Group([BY_MODEL], _by_model)], None)
    if logs[0].log.joint not in names or logs[0].log.unit != "rad":
        return list(logs), ""
    i = names.index(logs[0].log.joint)
    others = [n for n in names if n != names[i] and moves(logs, n)]
    near = [n for n in others if abs(names.index(n) - i) == 1 and not told(logs, n)]
    middle = {n: float(np.mean(np.concatenate([c.others[n] for c in logs]))) for n in others}

    def shared(c: Clean, name: str, share: float) -> Array:
        return _inertia(c, name, names.index(name) > i, share)

    def turned(c: Clean, name: str, share: float) -> Array:
        return _turned(c, name, middle[name], share)

    def summed(c: Clean, name: str, share: float) -> Array:
        pulls = shared(c, name, share) if name in near else _bend(c, name, share)
        return np.hstack([pulls, turned(c, name, share)])

    def moving(c: Clean) -> Array:
        return np.hstack([x(c, n, 0.0) for n in others for x in (_bend, turned)])

    groups = [_Group(near, shared)]
    asked = anywhere and len(others) > len(near) and all(c.effort is not None for c in logs)
    if asked and _inflation(logs, moving) < INFLATED:
        groups.append(_Group(others, summed, summed=True))
    return _looked_for(logs, reference, groups, lambda c: _gravity(c, near))


Columns = Callable[[Clean, str, float], Array]
"""Regressors (n, k) of what a joint's motion, a share of the log later, draws."""
BY_MODEL = "all others, by the model"


@dataclass(frozen=True)
class _Group:
    """Joints whose motion may draw effort, and the regressors of each; whether their gravity is
    among these, `summed` over joints.
    """

    names: Sequence[str]
    columns: Columns
    summed: bool = False


def _by_model(c: Clean, _: str, share: float) -> Array:
    """What all others draw by the model of the robot, which needs one factor only."""
    y = np.asarray(c.coupling)
    return np.roll(y, round(share * y.size))[:, None]


def _looked_for(
    logs: Sequence[Clean],
    reference: Clean | None,
    groups: Sequence[_Group],
    beside: Callable[[Clean], Array] | None,
) -> tuple[list[Clean], str]:
    """The logs with what the last one of the `groups` draws that says more than those before it,
    beyond what the first one drew in the `reference`.
    """
    before = {} if reference is None else dict(reference.draws)
    there = set.intersection(*(set(c.others) for c in logs)) | {n for g in groups for n in g.names}
    if not set(before) <= there:
        before = {}
    known = _explained(logs, groups[0], before)
    told = "what other joints draw of the effort is as in the reference" if before else ""
    if any(target(c) is None for c in logs):
        return known, told
    found: _Draws | None = None
    for group in (g for g in groups if g.names):
        least = np.inf if found is None else found.left
        found = _draws(known, beside, group, least) or found
    if found is None:
        return known, told
    group = found.group
    draws = {**before, **{n: d + before.get(n, 0.0) for n, d in found.draws.items()}}
    whose, how = f"accelerations of {' and '.join(found.draws)} draw", "fitted"
    if BY_MODEL in draws:
        whose = "the other joints' motion draws"
        how = f"by the model times {draws[BY_MODEL][0]:.3g}"
    elif group.summed:
        drawn = {n: [group.columns(c, n, 0.0) @ d for c in logs] for n, d in found.draws.items()}
        most = max(drawn, key=lambda n: float(np.std(np.concatenate(drawn[n]))))
        whose = f"the other joints' motion, most of all that of {most}, draws"
        how = "fitted as a sum over them, near these poses (--model says it of all)"
    beyond = " beyond what the reference has" if before else ""
    said = f"{whose} effort here{beyond}: {found.said}; {how}, and part of the twin"
    return _explained(logs, group, draws), said


def _explained(logs: Sequence[Clean], group: _Group, draws: Mapping[str, Array]) -> list[Clean]:
    """The logs with what each joint draws by the group's regressors."""
    if not draws:
        return list(logs)
    return [
        replace(
            c,
            drawn=np.sum([group.columns(c, n, 0.0) @ d for n, d in draws.items()], axis=0),
            draws=draws,
        )
        for c in logs
    ]


@dataclass(frozen=True)
class _Draws:
    """What is fitted of a group's motion: coefficients (k,) by joint, how much that explains, and
    the mean square that is `left` of what is held out.
    """

    group: _Group
    draws: Mapping[str, Array]
    explained: float
    left: float

    @property
    def said(self) -> str:
        return f"{100 * self.explained:.0f} % of what inertia, friction and gravity leave"


def _draws(
    logs: Sequence[Clean],
    beside: Callable[[Clean], Array] | None,
    group: _Group,
    least: float,
) -> _Draws | None:
    """The regression of the effort on what a group's motion may draw, next to a joint's own
    regressors and those ``beside`` (n, m), for which a sum over all joints stands itself; None if
    that predicts what is held out no better than these do, than another group (mean square
    ``least``), or than the same motion at other times.
    """
    base, near, y, fold = [], [], [], []
    extra: list[list[Array]] = [[] for _ in SHIFTS]
    widths: list[int] = []
    for log, c in enumerate(logs):
        kept = np.flatnonzero(counted(c))[:: c.step]
        kept = first_visits(c, kept) if group.summed else kept
        base.append(np.hstack([design(replace(c, step=1)), of_twist(c)])[kept])
        near.append((np.empty((c.q.size, 0)) if beside is None else beside(c))[kept])
        for made, share in zip(extra, SHIFTS, strict=True):
            parts = [group.columns(c, n, share)[kept] for n in group.names]
            widths = [part.shape[1] for part in parts]
            made.append(np.hstack(parts))
        y.append(np.asarray(target(c))[kept])
        fifth = np.arange(kept.size) * 5 // max(kept.size, 1)
        fold.append(fifth if len(logs) < 4 else np.full(kept.size, log % 5))
    x, by, e, f = (np.concatenate(held) for held in (base, near, y, fold))
    z, *elsewhen = (np.concatenate(held) for held in extra)
    if e.size < FEWEST or np.unique(f).size < 2:
        return None
    plain = held_out(np.hstack([x, by]), e, f)
    x = x if group.summed else np.hstack([x, by])
    left = held_out(np.hstack([x, z]), e, f)
    helps = HELPS if len(logs) > 1 else HELPS_ONE
    if left > helps * min(plain, least):
        return None
    if left > helps * min(held_out(np.hstack([x, other]), e, f) for other in elsewhen):
        return None
    beta = _fitted(np.hstack([x, z]), e)[x.shape[1] :]
    own = dict(zip(group.names, np.split(beta, np.cumsum(widths)[:-1]), strict=True))
    return _Draws(group, own, 1 - left / plain, left)


def _gravity(c: Clean, neighbours: Sequence[str]) -> Array:
    """Sine and cosine (n, 4 each) of the sum and the difference with each neighbour's angle."""
    out: list[Array] = []
    for name in neighbours:
        for sign in (1.0, -1.0):
            angle = c.q + sign * c.others[name]
            out += [np.sin(angle), np.cos(angle)]
    return np.asarray(np.reshape(out, (len(out), c.q.size)).T)


def _inertia(c: Clean, name: str, outwards: bool, share: float = 0.0) -> Array:
    """Regressors (n, 3) of the effort that a neighbour's motion draws: of its acceleration, and of
    the cosine and sine of the angle between the two with what turns with it (Coriolis); of its
    motion a `share` of the log later.
    """
    theta = c.others[name]
    w = derivative(theta, c.dt)
    b = derivative(w, c.dt)
    theta, w, b = (np.roll(y, round(share * y.size)) for y in (theta, w, b))
    if outwards:  # the neighbour's own angle lies between
        angle, pull, turn = theta, 2 * c.a + b, 2 * c.v * w + w**2
    else:
        angle, pull, turn = c.q, b, -(w**2)
    columns = [
        b,
        np.cos(angle) * pull - np.sin(angle) * turn,
        np.sin(angle) * pull + np.cos(angle) * turn,
    ]
    return np.stack(columns, axis=1)


def _bend(c: Clean, name: str, share: float) -> Array:
    """Acceleration (n, 1) of a joint anywhere in the arm, a `share` of the log later."""
    bend = derivative(derivative(c.others[name], c.dt), c.dt)
    return np.roll(bend, round(share * bend.size))[:, None]


def _turned(c: Clean, name: str, middle: float, share: float) -> Array:
    """Sine and cosine (n, 2) of such a joint's angle from the `middle`, where they are 0, so that
    no constant is drawn; of its motion a `share` of the log later.
    """
    theta = np.roll(c.others[name] - middle, round(share * c.q.size))
    return np.stack([np.sin(theta), np.cos(theta) - 1.0], axis=1)


def _inflation(logs: Sequence[Clean], drawn: Callable[[Clean], Array]) -> float:
    """Variance inflation factor of the own acceleration beside what others may draw (n, k)."""
    kept = [first_visits(c, np.flatnonzero(counted(c))[:: c.step]) for c in logs]
    own = np.concatenate([c.a[k] for c, k in zip(logs, kept, strict=True)])
    others = np.concatenate([drawn(c)[k] for c, k in zip(logs, kept, strict=True)])
    return float(inflation(own[:, None], np.column_stack([np.ones(own.size), others]))[0])


def _fitted(x: Array, y: Array) -> Array:
    norm = np.sqrt(np.mean(x**2, axis=0)) + 1e-12
    z = x / norm
    gram = z.T @ z + RIDGE * y.size * np.eye(z.shape[1])
    return np.asarray(np.linalg.solve(gram, z.T @ y) / norm)
