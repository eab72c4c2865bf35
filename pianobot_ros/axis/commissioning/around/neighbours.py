"""Effort that the acceleration of neighbouring joints draws, where no model of the robot says it.

Two neighbours of a serial arm share inertia: I + c cos(angle between their links). Its constant and
its sine and cosine are fitted by regression beside inertia, friction and gravity, and count only if
what is held out is predicted much better with them, and than with the same motions at other times:
joints that move at the same rates explain each other's leftovers with any phase.

What is a neighbour's and what the joint's own inertia hangs on how both happened to move: with
coefficients of each log's own, two logs of one machine have different inertias, as if something
had been added. So of a joint with a reference they are that one's, and only what is drawn beyond
them is looked for.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pianobot_ros.axis.commissioning.around.arm import target
from pianobot_ros.axis.commissioning.around.other_joints import moves
from pianobot_ros.axis.commissioning.regression import (
    HELPS,
    HELPS_ONE,
    design,
    held_out,
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
    logs: Sequence[Clean], reference: Clean | None = None
) -> tuple[list[Clean], str]:
    """The logs with what neighbouring joints' accelerations draw of the effort, or as they are; and
    what there is to say of it. What they drew in a `reference` is known.
    """
    names = logs[0].log.joints
    if all(c.coupling is not None for c in logs):
        return _looked_for(logs, reference, [BY_MODEL], _by_model, None)
    if logs[0].log.joint not in names or logs[0].log.unit != "rad":
        return list(logs), ""
    i = names.index(logs[0].log.joint)
    near = [names[k] for k in (i - 1, i + 1) if 0 <= k < len(names) and moves(logs, names[k])]

    def columns(c: Clean, name: str, share: float) -> Array:
        return _inertia(c, name, names.index(name) > i, share)

    return _looked_for(logs, reference, near, columns, lambda c: _gravity(c, near))


Columns = Callable[[Clean, str, float], Array]
"""Regressors (n, k) of what a joint's motion, a share of the log later, draws."""
BY_MODEL = "all others, by the model"


def _by_model(c: Clean, _: str, share: float) -> Array:
    """What all others draw by the model of the robot, which needs one factor only."""
    y = np.asarray(c.coupling)
    return np.roll(y, round(share * y.size))[:, None]


def _looked_for(
    logs: Sequence[Clean],
    reference: Clean | None,
    near: Sequence[str],
    columns: Columns,
    beside: Callable[[Clean], Array] | None,
) -> tuple[list[Clean], str]:
    """The logs with what joints `near` draw, beyond what those of the `reference` did."""
    before = {} if reference is None else dict(reference.draws)
    there = {BY_MODEL} if BY_MODEL in near else set.intersection(*(set(c.others) for c in logs))
    if not set(before) <= there:
        before = {}
    known = _explained(logs, columns, before)
    told = "what other joints draw of the effort is as in the reference" if before else ""
    if not near or any(target(c) is None for c in logs):
        return known, told
    found = _draws(known, beside, lambda c, s: np.hstack([columns(c, n, s) for n in near]))
    if found is None:
        return known, told
    own = dict(zip(near, found.beta.reshape(len(near), -1), strict=True))
    draws = {**before, **{n: beta + before.get(n, 0.0) for n, beta in own.items()}}
    whose = f"accelerations of {' and '.join(near)} draw"
    how = "fitted"
    if BY_MODEL in draws:
        whose = "the other joints' motion draws"
        how = f"by the model times {draws[BY_MODEL][0]:.3g}"
    beyond = " beyond what the reference has" if before else ""
    said = f"{whose} effort here{beyond}: {found.said}; {how}, and part of the twin"
    return _explained(logs, columns, draws), said


def _explained(logs: Sequence[Clean], columns: Columns, draws: Mapping[str, Array]) -> list[Clean]:
    """The logs with what each joint draws."""
    if not draws:
        return list(logs)
    return [
        replace(
            c, drawn=np.sum([columns(c, n, 0.0) @ d for n, d in draws.items()], axis=0), draws=draws
        )
        for c in logs
    ]


@dataclass(frozen=True)
class _Draws:
    """What is fitted of other joints' motion: coefficients (k,), and how much that explains."""

    beta: Array
    explained: float

    @property
    def said(self) -> str:
        return f"{100 * self.explained:.0f} % of what inertia, friction and gravity leave"


def _draws(
    logs: Sequence[Clean],
    beside: Callable[[Clean], Array] | None,
    drawn: Callable[[Clean, float], Array],
) -> _Draws | None:
    """The regression of the effort on what other joints' motion may draw, (n, k) each with the
    motion a share of the log later, next to a joint's own regressors and those ``beside`` (n, m);
    None if that predicts what is held out no better.
    """
    base, y, fold = [], [], []
    extra: list[list[Array]] = [[] for _ in SHIFTS]
    for n, c in enumerate(logs):
        kept = np.flatnonzero(counted(c))[:: c.step]
        own = [design(replace(c, step=1)), of_twist(c), *([] if beside is None else [beside(c)])]
        base.append(np.hstack(own)[kept])
        for made, share in zip(extra, SHIFTS, strict=True):
            made.append(drawn(c, share)[kept])
        y.append(np.asarray(target(c))[kept])
        parts = np.arange(kept.size) * 5 // max(kept.size, 1)
        fold.append(parts if len(logs) < 4 else np.full(kept.size, n % 5))
    x, e, f = (np.concatenate(held) for held in (base, y, fold))
    z, *elsewhen = (np.concatenate(held) for held in extra)
    if e.size < FEWEST or np.unique(f).size < 2:
        return None
    plain, left = held_out(x, e, f), held_out(np.hstack([x, z]), e, f)
    helps = HELPS if len(logs) > 1 else HELPS_ONE
    if left > helps * plain:
        return None
    if left > helps * min(held_out(np.hstack([x, other]), e, f) for other in elsewhen):
        return None
    return _Draws(_fitted(np.hstack([x, z]), e)[x.shape[1] :], 1 - left / plain)


def _gravity(c: Clean, neighbours: Sequence[str]) -> Array:
    """Sine and cosine (n, 4 each) of the sum and the difference with each neighbour's angle."""
    out: list[Array] = []
    for name in neighbours:
        for sign in (1.0, -1.0):
            angle = c.q + sign * c.others[name]
            out += [np.sin(angle), np.cos(angle)]
    return np.stack(out, axis=1)


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


def _fitted(x: Array, y: Array) -> Array:
    norm = np.sqrt(np.mean(x**2, axis=0)) + 1e-12
    z = x / norm
    gram = z.T @ z + RIDGE * y.size * np.eye(z.shape[1])
    return np.asarray(np.linalg.solve(gram, z.T @ y) / norm)
