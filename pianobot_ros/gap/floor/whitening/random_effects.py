"""What is another in each block: its parameters, its moment, its level.

Repeats differ by what the robot did as well as by noise: a joint was stiffer this time, a finger
higher, a motion earlier. Such a difference moves the whole signal by a shape that the twin knows:
its derivative by a parameter or by time, or a level. As stationary noise it would be as likely in
any other shape, and laws would be chosen by shapes that no repeat takes. So the residual of a block
has a random part along these directions (a mixed model: Laird and Ware 1982, Biometrics 38), whose
variances are estimated from what repeats differ by, by expectation maximisation.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from pianobot_ros.gap.floor.repeats import Repeats, split
from pianobot_ros.gap.floor.whitening.whiten import Whitener
from pianobot_ros.gap.problem.constants import FEWEST_SAMPLES, NEGLIGIBLE, SMALL, TINY
from pianobot_ros.gap.problem.problem import Problem
from pianobot_ros.gap.problem.types import Array

__all__ = ["RandomEffects", "directions", "inverse_root", "random_effects"]


@dataclass(frozen=True, eq=False)
class RandomEffects:
    """How much blocks differ along each direction, `deviation` (k,) in its unit; and what is left
    of their wander: its deviation `correlated` and time `tau` (s).
    """

    deviation: Array
    correlated: float
    tau: float

    def larger(self, times: float) -> RandomEffects:
        """The same, all of it so many times as large."""
        return RandomEffects(times * self.deviation, times * self.correlated, self.tau)


@dataclass(frozen=True)
class _Row:
    """What sets a repeat apart from the mean of its condition (n,) at times `t` (n,), with the
    n/(n-1) correction, and the condition's directions (n, k).
    """

    t: Array
    apart: Array
    along: Array


@dataclass(frozen=True)
class _Step:
    """Random effects with their log likelihood; and of each row the most probable effects `mean`
    (rows, k) and their `covariance` (rows, k, k).
    """

    effects: RandomEffects
    likelihood: float
    mean: Array
    covariance: Array


def directions(problem: Problem, prediction: Array, jacobian: Array) -> Array:
    """Directions (size, p + 2) in which blocks may differ: the `jacobian` (size, p) of a prediction
    (size,), its rate, and a level.
    """
    rate = np.zeros(problem.size)
    for c in problem.cells:
        at = c.start + np.flatnonzero(problem.mask[c.start : c.stop])
        if at.size > 1:
            change, pace = np.gradient(prediction[at]), np.gradient(c.t[at - c.start])
            rate[at] = np.divide(change, pace, out=np.zeros(at.size), where=pace > 0.0)
    return np.column_stack([jacobian, rate, np.ones(problem.size)])


def random_effects(
    groups: Iterable[Repeats],
    residual: Array,
    along: Array,
    noise: tuple[float, float, float],
) -> RandomEffects | None:
    """By what repeats of one series differ by along the directions `along` (size, k). `noise`:
    their white deviation, that of their wander, and its time (s). None where repeats are as likely
    without, each variance being worth half the logarithm of how many repeats there are (Schwarz
    1978, Annals of Statistics 6).
    """
    rows, freedom = _rows(groups, residual, along)
    if not rows:
        return None
    white, correlated, tau = noise
    size = np.sqrt(np.mean(np.concatenate([r.along for r in rows]) ** 2, axis=0))
    scatter = float(np.hypot(white, correlated))
    first = np.where(size > 0.0, scatter / np.maximum(size, TINY), 0.0)
    plain = _maximised(rows, white, RandomEffects(0.0 * first, correlated, tau))
    best = _maximised(rows, white, RandomEffects(first, correlated, tau))
    while True:
        step = _maximised(rows, white, _wander_left(rows, white, best))
        if step.likelihood < best.likelihood + SMALL:
            break
        best = step
    part = best.effects.deviation * size
    own = np.where(part**2 > NEGLIGIBLE * scatter**2, best.effects.deviation, 0.0)
    price = 0.5 * np.count_nonzero(own) * np.log(max(freedom, 1))
    gain = (best.likelihood - plain.likelihood) * freedom / len(rows)
    if not own.any() or gain <= price:
        return None
    return RandomEffects(own, best.effects.correlated, best.effects.tau)


def inverse_root(a: Array) -> Array:
    """M (k, k) with (1 + a aᵀ)^(-1/2) = 1 - a M aᵀ, for `a` (n, k)."""
    value, vector = np.linalg.eigh(a.T @ a)
    value = np.maximum(value, 0.0)
    root = np.sqrt(1.0 + value)
    return np.asarray((vector / (root * (root + 1.0))) @ vector.T)


def _rows(groups: Iterable[Repeats], residual: Array, along: Array) -> tuple[list[_Row], int]:
    """The rows of all conditions, and how many of them are free beside the means. The directions
    are those that a condition's repeats have in common: each alone holds the noise of what it is
    predicted from, as the residual does, and would be told by it.
    """
    rows: list[_Row] = []
    freedom = 0
    for g in groups:
        if g.times.size < FEWEST_SAMPLES:
            continue
        alike = along[g.at].mean(0)
        rows += [_Row(g.times, x, alike) for x in g.scatter(residual)]
        freedom += len(g.cells) - 1
    return rows, freedom


def _maximised(rows: Sequence[_Row], white: float, effects: RandomEffects) -> _Step:
    """The likeliest random effects from these on, beside a wander that stays; what is nothing stays
    so.
    """
    table, density = _products(rows, white, effects.correlated, effects.tau)
    gram, cross, square = table[:, 1:, 1:], table[:, 1:, 0], table[:, 0, 0]
    deviation, known = effects.deviation, -np.inf
    while True:
        inner = np.eye(deviation.size) + deviation[:, None] * gram * deviation
        covariance = deviation[:, None] * np.linalg.inv(inner) * deviation
        mean = np.einsum("rij,rj->ri", covariance, cross)
        fitted = square - np.einsum("ri,ri->r", cross, mean)
        likelihood = density - 0.5 * float(np.sum(fitted + np.linalg.slogdet(inner)[1]))
        if likelihood < known + NEGLIGIBLE:
            found = RandomEffects(deviation, effects.correlated, effects.tau)
            return _Step(found, likelihood, mean, covariance)
        own = np.diagonal(covariance, axis1=1, axis2=2)
        deviation, known = np.sqrt(np.mean(mean**2 + own, axis=0)), likelihood


def _products(
    rows: Sequence[_Row], white: float, correlated: float, tau: float
) -> tuple[Array, float]:
    """Products (rows, 1 + k, 1 + k) of each row's whitened residual and directions with each other,
    and the sum of the logarithms of what they were scaled by.
    """
    products, density = [], 0.0
    for r in rows:
        filter_ = Whitener.of(r.t, np.full(r.t.size, max(white, TINY)), (correlated, tau))
        z = filter_.apply(np.column_stack([r.apart, r.along]))
        products.append(z.T @ z)
        density += float(np.log(filter_.scale).sum())
    return np.array(products), density


def _wander_left(rows: Sequence[_Row], white: float, step: _Step) -> RandomEffects:
    """The same effects with the wander that repeats have beside them."""
    left = [r.apart - r.along @ m for r, m in zip(rows, step.mean, strict=True)]
    open_ = [
        float(np.mean(np.einsum("ni,ij,nj->n", r.along, c, r.along)))
        for r, c in zip(rows, step.covariance, strict=True)
    ]
    square = float(np.mean([np.mean(x**2) + o for x, o in zip(left, open_, strict=True)]))
    tau = split(left, [r.t for r in rows])[2]
    wander = float(np.sqrt(max(square - white**2, 0.0)))
    return RandomEffects(step.effects.deviation, wander, tau)
