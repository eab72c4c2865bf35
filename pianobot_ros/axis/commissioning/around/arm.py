"""Gravity that other joints of the robot turn: which ones, and how large it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.axis.commissioning.around.contact_limit import untouched
from pianobot_ros.axis.commissioning.around.other_joints import moves, told
from pianobot_ros.axis.commissioning.regression import (
    HELPS,
    HELPS_ONE,
    design,
    hanging,
    held_out,
    robust,
)
from pianobot_ros.axis.laws.load.contact import Contact
from pianobot_ros.axis.signals.cleaning import Clean, counted
from pianobot_ros.axis.signals.lateness import beyond_delay
from pianobot_ros.gap.problem.types import Array

__all__ = ["arm_load", "coupling", "first_visits", "target", "turned"]

FEWEST = 20
"""Slow samples without which other joints are not looked at. With 23 to 27 of them 6 of 80
simulated arms seem to hang by a joint that does not turn them, and 75 of 80 that do are found; with
35 it is 1 and 39 of 40 (logs of one run; `tests/axis/cascade.py`)."""
POSE = 0.05
"""rad by which poses differ."""
SLOW = 0.3
"""Of the RMS speed; faster samples tell of the loop rather than of the load."""


def coupling(
    logs: Sequence[Clean], joint: str, names: Sequence[str], touched: Contact | None = None
) -> dict[str, float]:
    """Signed sum of other joints' angles that gravity follows best, by held-out regression: joint
    to +1 or -1; empty if none helps.

    Asked of effort, or of command minus position where none was measured. `names` are all joints
    in the order of the robot; joints next to this one are tried, and pairs of them, where the
    joint's own motion does not tell theirs (see `told`). What the joint does in contact with
    `touched` does not count.
    """
    if joint not in names:
        return {}
    i = names.index(joint)
    chains = [[k] for k in (i - 1, i + 1)] + [[i - 1, i - 2], [i + 1, i + 2]]
    sums: list[dict[str, float]] = []
    for chain in chains:
        if min(chain) < 0 or max(chain) >= len(names):
            continue
        own = [names[k] for k in chain]
        if all(moves(logs, n) and not told(logs, n) for n in own):
            signs = product((1.0, -1.0), repeat=len(own))
            sums += [dict(zip(own, s, strict=True)) for s in signs]
    if not sums:
        return {}
    kept = [_kept(c, touched) for c in logs]
    x, y, fold = _load_regression(logs, kept)
    if y.size < FEWEST or np.unique(fold).size < 2:
        return {}
    plain = held_out(x, y, fold)
    best, chosen = (HELPS if len(logs) > 1 else HELPS_ONE) * plain, dict[str, float]()
    for theta in sums:
        parts = [turned(c, theta)[k] for c, k in zip(logs, kept, strict=True) if _asked(c)]
        extra = np.concatenate(parts)
        left = held_out(np.hstack([x, extra]), y, fold) * (1.0 + 0.02 * len(theta))
        if left < best:
            best, chosen = left, theta
    return chosen


def target(c: Clean) -> Array | None:
    """What the load shows in, (n,): effort, or command minus position, beyond what a delay makes of
    it, where none was measured.
    """
    if c.effort is not None:
        return c.own_effort
    if c.command is None:
        return None
    return c.left(beyond_delay(c))


def _asked(c: Clean) -> bool:
    return target(c) is not None


def _kept(c: Clean, touched: Contact | None) -> NDArray[np.intp]:
    """Samples (k,) of which the load is asked: slow ones, ten a second, one of each pose. The few
    poses of a task that is done again and again say no more the second time.
    """
    step = max(1, round(0.1 / c.dt))
    driver = c.q if c.command is None else c.command
    speed = np.abs(np.gradient(driver, c.dt))
    still = (untouched(c, touched) > 0) & (
        speed < max(SLOW * float(np.sqrt(np.mean(speed**2))), 1e-9)
    )
    return first_visits(c, np.flatnonzero(still)[::step])


def first_visits(c: Clean, samples: NDArray[np.intp]) -> NDArray[np.intp]:
    """Those of the `samples` (n,) at which the robot is in a pose for the first time, in order."""
    poses = np.round(np.array([c.q, *c.others.values()])[:, samples] / POSE)
    return np.asarray(samples[np.sort(np.unique(poses, axis=1, return_index=True)[1])])


def turned(c: Clean, theta: Mapping[str, float]) -> Array:
    """Sine and cosine (n, 2) of the angle that the signed sum `theta` of other joints' turns."""
    angle = c.q.copy()
    for joint, sign in theta.items():
        angle += sign * c.others[joint]
    return np.stack([np.sin(angle), np.cos(angle)], axis=1)


def arm_load(logs: Sequence[Clean], arm: Mapping[str, float]) -> dict[str, float]:
    """Inertia, friction, own gravity, and gravity that the signed sum `arm` of other joints' angles
    turns, by robust least squares of effort, or of command minus position where none was measured.
    """
    xs, ys = [], []
    for c in logs:
        y = target(c)
        if y is not None and all(n in c.others for n in arm):
            kept = counted(c)[:: c.step]
            xs.append(np.hstack([design(c), turned(c, arm)[:: c.step]])[kept])
            ys.append(y[:: c.step][kept])
    if not xs:
        return {}
    x = np.concatenate(xs)
    beta = robust(x, np.concatenate(ys), np.zeros(x.shape[1]))
    (own, own_angle), (gravity, angle) = hanging(beta[4], beta[5]), hanging(beta[6], beta[7])
    return {
        "inertia": float(beta[0]),
        "viscous": float(beta[1]),
        "coulomb": max(float(beta[3]), 0.0),
        "arm_own": own,
        "arm_own_angle": own_angle,
        "arm_gravity": gravity,
        "arm_angle": angle,
    }


def _load_regression(
    logs: Sequence[Clean], samples: Sequence[NDArray[np.intp]]
) -> tuple[Array, Array, Array]:
    xs, ys, folds = [], [], []
    for k, (c, kept) in enumerate(zip(logs, samples, strict=True)):
        y = target(c)
        if y is None:
            continue
        slow = max(0.1 * float(np.sqrt(np.mean(c.v**2))), 1e-9)
        x = np.array([np.ones(c.v.size), c.a, c.v, np.tanh(c.v / slow), np.sin(c.q), np.cos(c.q)]).T
        xs.append(x[kept])
        ys.append(y[kept])
        n = kept.size
        folds.append(np.arange(n) * 5 // max(n, 1) if len(logs) < 4 else np.full(n, k % 5))
    return np.concatenate(xs), np.concatenate(ys), np.concatenate(folds)
