"""Whether a load seems to be carried for a part of a log, as in pick and place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.axis.commissioning.around.arm import target, turned
from pianobot_ros.axis.commissioning.around.other_joints import moves
from pianobot_ros.axis.commissioning.regression import HELPS_ONE, design, hanging
from pianobot_ros.axis.laws.load.carried_load import CYCLE, G
from pianobot_ros.axis.signals.cleaning import Clean, counted
from pianobot_ros.axis.signals.segment import repetition, stretches
from pianobot_ros.gap.problem.types import Array

__all__ = ["carried"]

EDGES = 40
"""Moments, evenly spread over the log, between which a load may be carried."""
FINER, STILL = 4, 0.02
"""Of a cycle so many times more moments, those in which nothing moves: share of the highest speed
below which a joint stands still."""
LEAST, MOST = 0.05, 0.9
"""Shares of the log for which it is: a shorter one is a blow, a longer one the joint's own."""


def carried(logs: Sequence[Clean], arm: Mapping[str, float]) -> dict[str, float]:
    """First values of the effect `carried_load` by least squares of effort (or of command minus
    position where none was measured) over all spans of the log, or of the cycle of a periodic
    command where effort was measured, by what explains more; empty if none explains much: without
    effort a load shows by the loop's sag alone, as whatever depends on the pose does.
    `carried_start` and `carried_period` are the first cycle's begin and length, s.

    The signed sum `arm` of other joints' angles turns the load too. What their poses may explain is
    none that is carried: a span of a motion that wanders is also one of poses. Of one log only:
    what is carried at which time of another one is another question.
    """
    if len(logs) != 1 or logs[0].log.unit == "m":
        return {}
    (c,) = logs
    y = target(c)
    if y is None or any(n not in c.others for n in arm):
        return {}
    kept = counted(c)[:: c.step]
    base, own = design(c)[kept], turned(c, arm)[:: c.step][kept]
    load = np.column_stack([own, base[:, 0]])  # gravity and inertia
    base = np.hstack([base, own]) if arm else base
    poses = _poses(c, kept)
    t = c.t[:: c.step][kept] - c.t[0]
    felt = y[:: c.step][kept]
    if t.size < 4 * EDGES:
        return {}
    edges = np.linspace(0.0, float(c.t[-1] - c.t[0]), EDGES + 1)
    found = _in_time(base, load, felt, t, edges, poses)
    cycle = None
    if c.command is not None and c.effort is not None:
        cycle = repetition(c.command, c.dt)
    when: dict[str, float] = {}
    if cycle is not None:
        start, period = cycle[0] * c.dt, cycle[2] * c.dt
        phase = start + np.mod(t - start, period)
        each = _in_time(base, load, felt, phase, _rests(c, start, period), poses)
        if each is not None and (found is None or each[0] > found[0]):
            found, when = each, dict(zip(CYCLE, (start, period), strict=True))
    if found is None:
        return {}
    _, begins, ends, (sine, cosine, inertia) = found
    gravity, angle = hanging(sine, cosine)
    return {
        "carried_load": gravity,
        "carried_angle": angle,
        "carried_reach": float(np.clip(G * inertia / max(gravity, 1e-12), 0.0, 3.0)),
        "carried_from": begins,
        "carried_until": ends,
        **when,
    }


def _poses(c: Clean, kept: NDArray[np.bool_]) -> Array:
    """Sines and cosines (n, 6 a joint) of what other joints that move may turn: their own angle,
    and that with this joint's either way.
    """
    found = [np.zeros((int(kept.sum()), 0))]
    for name in (n for n in c.others if moves([c], n)):
        y = c.others[name]
        angles = np.stack([y, c.q + y, c.q - y], axis=1)[:: c.step][kept]
        found.append(np.hstack([np.sin(angles), np.cos(angles)]))
    return np.hstack(found)


def _left(x: Array, felt: Array) -> float:
    """Squared residual of `felt` (n,) beside x (n, k)."""
    left = felt - x @ np.linalg.lstsq(x, felt, rcond=None)[0]
    return float(left @ left)


def _rests(c: Clean, start: float, period: float) -> Array:
    """Middles (e,), s since the log began, of the rests of the cycle from ``start`` on, in which
    the robot stands still in every cycle: there parts are taken up and put down.
    """
    assert c.command is not None
    others = (y for name, y in c.others.items() if moves([c], name))
    speeds = [np.abs(np.gradient(y)) for y in (c.command, *others)]
    fast = [v > STILL * float(np.quantile(v, 0.99)) for v in speeds]
    cell = period / (FINER * EDGES)
    phase = np.mod(c.t - c.t[0] - start, period)
    stands = np.ones(FINER * EDGES, bool)
    stands[np.minimum((phase[np.any(fast, axis=0)] / cell).astype(int), stands.size - 1)] = False
    return np.asarray(start + cell * stretches(stands).mean(1))


def _in_time(
    base: Array, load: Array, felt: Array, t: Array, edges: Array, poses: Array
) -> tuple[float, float, float, Array] | None:
    """The best span of samples at times t (n,) s between two `edges` (e,) s: what it explains, its
    begin and end in s, and the load's coefficients (k,), see `_best_span`; None if it explains
    little beside what `poses` (n, p) do.
    """
    if edges.size < 2:
        return None
    order = np.argsort(t, kind="stable")
    at = np.searchsorted(t[order], edges)
    found = _best_span(base[order], load[order], felt[order], at)
    if found is None:
        return None
    gain, begins, ends, coefficients = found
    if poses.size:
        inside = (t >= edges[begins]) & (t < edges[ends])
        beside = np.hstack([base, poses])
        with_load = np.hstack([beside, load * inside[:, None]])
        if _left(with_load, felt) > HELPS_ONE * _left(beside, felt):
            return None
    return gain, float(edges[begins]), float(edges[ends]), coefficients


def _best_span(
    base: Array, load: Array, felt: Array, at: NDArray[np.intp]
) -> tuple[float, int, int, Array] | None:
    """Between which two of the samples `at` (e,) the regressors `load` (n, k) explain most of
    `felt` (n,) beside `base` (n, p), which count throughout: how much, which two, and the load's
    coefficients (k,); None if that is little. All that a span needs are sums of products over it.
    """
    k, p, n = load.shape[1], base.shape[1], felt.size
    size = np.sqrt(np.mean(np.hstack([load, base]) ** 2, axis=0)) + 1e-12
    load, base = load / size[:k], base / size[k:]
    products = load[:, :, None] * np.hstack([load, base, felt[:, None]])[:, None, :]
    sums = np.concatenate([np.zeros((1, *products.shape[1:])), np.cumsum(products, axis=0)])[at]
    i, j = np.triu_indices(at.size, 1)
    share = (at[j] - at[i]) / n
    asked = (share >= LEAST) & (share <= MOST) & (at[j] - at[i] > 3 * k)
    i, j = i[asked], j[asked]
    if not i.size:
        return None
    whole = base.T @ base + 1e-9 * n * np.eye(p)
    plain = np.linalg.solve(whole, base.T @ felt)
    rest = float(felt @ felt - plain @ (base.T @ felt))
    span = sums[j] - sums[i]  # (spans, k, k + p + 1)
    cross = span[:, :, k:-1]
    own = span[:, :, :k] - cross @ np.linalg.solve(whole, cross.transpose(0, 2, 1))
    wanted = span[:, :, -1] - cross @ plain
    solved = np.linalg.solve(own + 1e-6 * n * np.eye(k), wanted[:, :, None])[:, :, 0]
    gain = np.sum(solved * wanted, axis=1)
    best = int(np.argmax(gain))
    if gain[best] < (1.0 - HELPS_ONE) * rest:
        return None
    return float(gain[best]), int(i[best]), int(j[best]), np.asarray(solved[best] / size[:k])
