"""Effort that the acceleration of neighbouring joints draws, where no model of the robot says it.

Two neighbours of a serial arm share inertia: I + c cos(angle between their links). Its constant and
its sine and cosine are fitted by regression beside inertia, friction and gravity, and count only if
what is held out is predicted much better with them, and than with the same motions at other times:
joints that move at the same rates explain each other's leftovers with any phase.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pianobot_ros.axis.commissioning.commission import (
    HELPS,
    HELPS_ONE,
    design,
    held_out,
    moves,
    target,
)
from pianobot_ros.axis.signals.cleaning import Clean, counted
from pianobot_ros.axis.signals.filtering import derivative
from pianobot_ros.gap.problem.types import Array

__all__ = ["with_neighbours"]

FEWEST = 400
"""Samples without which neighbours are not looked at."""
SHIFTS = (0.0, 0.25, 0.5, 0.75)
"""Shares of a log by which neighbours' motions are shifted, to see what any phase explains."""
RIDGE = 1e-3


def with_neighbours(logs: Sequence[Clean]) -> tuple[list[Clean], str]:
    """The logs with what neighbouring joints' accelerations draw of the effort, or as they are; and
    what there is to say of it.
    """
    first = logs[0].log
    names = first.joints
    if all(c.coupling is not None for c in logs):
        return _by_model(logs)
    if first.joint not in names or first.unit != "rad":
        return list(logs), ""
    i = names.index(first.joint)
    beside = [k for k in (i - 1, i + 1) if 0 <= k < len(names) and moves(logs, names[k])]
    if not beside or any(target(c) is None for c in logs):
        return list(logs), ""
    near = [names[k] for k in beside]
    found = _draws(logs, lambda c: _gravity(c, near), lambda c, share: _drawn(c, beside, i, share))
    if found is None:
        return list(logs), ""
    explained = [replace(c, drawn=_drawn(c, beside, i) @ found.beta) for c in logs]
    return explained, (
        f"accelerations of {' and '.join(near)} draw effort here: {found.said}; fitted, and part of"
        " the twin"
    )


def _by_model(logs: Sequence[Clean]) -> tuple[list[Clean], str]:
    """The same by the model of the robot, whose couplings need one factor only."""

    def coupling(c: Clean, share: float = 0.0) -> Array:
        y = np.asarray(c.coupling)
        return np.roll(y, round(share * y.size))[:, None]

    if any(target(c) is None for c in logs):
        return list(logs), ""
    found = _draws(logs, None, coupling)
    if found is None:
        return list(logs), ""
    explained = [replace(c, drawn=coupling(c) @ found.beta) for c in logs]
    return explained, (
        f"the other joints' motion draws effort here: {found.said}; by the model times"
        f" {found.beta[0]:.3g}, and part of the twin"
    )


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
        own = [design(replace(c, step=1)), *([] if beside is None else [beside(c)])]
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


def _drawn(c: Clean, beside: Sequence[int], own: int, share: float = 0.0) -> Array:
    """Regressors (n, 3 each) of the joints `beside` the `own` one, by number."""
    return np.hstack([_inertia(c, c.log.joints[k], k > own, share) for k in beside])


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
