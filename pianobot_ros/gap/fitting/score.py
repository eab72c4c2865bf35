"""Out-of-sample scores of hypotheses and what they weigh.

Every hypothesis is refitted without the held-out units (one Gauss-Newton step from the full fit:
the units' normal equations are stored, so this costs no simulation) and scored on them, once with
blocks drawn from all conditions and once with whole conditions left out, so that extrapolation
counts. What the other units leave open of the parameters widens the prediction (the linear Gaussian
posterior predictive), so that a flexible law is not blamed for what nothing has told it yet.
The weights are pseudo-BMA+ (Yao, Vehtari, Simpson and Gelman 2018): a Bayesian bootstrap
over blocks, so that a difference that rests on a few blocks is not believed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.gap.fitting.fit import Fit, Fitter
from pianobot_ros.gap.fitting.quadratic import Quadratic, solve_map, summed
from pianobot_ros.gap.fitting.space import Space
from pianobot_ros.gap.problem.constants import DRAWS, ENOUGH, FAR, NEGLIGIBLE
from pianobot_ros.gap.problem.problem import Problem
from pianobot_ros.gap.problem.types import Array


@dataclass(frozen=True)
class Scored:
    """Held-out log score `each` per unit and observable (u, o), and the parameters `v` (folds, p)
    fitted without each fold of `folds[0]`.
    """

    each: Array
    fold_v: Array

    @property
    def per_unit(self) -> Array:
        """Score per unit (u,)."""
        return np.asarray(self.each.sum(1))


def folds_of(problem: Problem, count: int, seed: int) -> tuple[Array, ...]:
    """Two ways of leaving out: unit to fold (u,), stratified by condition; and by whole conditions
    where there are ≥ 3.
    """
    rng = np.random.default_rng(seed)
    few = len(problem.blocks) < ENOUGH
    of_unit = np.arange(problem.n_units) if few else problem.block_of_unit
    members = np.unique(of_unit)
    k, drawn = min(count, members.size), rng.random(members.size)
    fold = np.empty(members.size, int)
    if few:  # contiguous pieces of time stay together
        fold[:] = np.arange(members.size) * k // members.size
    else:
        fold[np.lexsort((drawn, problem.condition_of_block[members]))] = np.arange(members.size) % k
    ways = [fold[np.searchsorted(members, of_unit)]]
    n_conditions = len(problem.conditions)
    if n_conditions >= 3:
        shuffled = rng.permutation(n_conditions) % min(count, n_conditions)
        ways.append(shuffled[problem.condition_of_block[problem.block_of_unit]])
    return tuple(ways)


def box(space: Space, v: Array, reach: Array | None = None) -> tuple[Array, Array]:
    """Least and largest step (p,) from `v`: within the bounds, and within `reach` (p,) where the
    linearisation is believed.
    """
    low, high = space.low - v, space.high - v
    return (low, high) if reach is None else (np.maximum(low, -reach), np.minimum(high, reach))


def refit(
    fitter: Fitter, part: Quadratic, v: Array, low: Array, high: Array
) -> tuple[Array, Array]:
    """Step (p,) from `v` within [low, high] that fits the units summed in `part`, and the mean
    squares per observable (o,) it reaches.
    """
    d = np.zeros(v.size)
    mean = part.mean(d)
    for _ in range(2):
        kappa = fitter.likelihood.kappa(mean)
        d = solve_map(np.tensordot(kappa, part.G, 1), kappa @ part.g, v, low, high)
        mean = part.mean(d)
    return d, mean


def open_parameters(
    left: Quadratic, d: Array, kappa: Array, train: Array, free: NDArray[np.bool_]
) -> Array:
    """What it adds to the log score (u, o) of held-out units that their prediction is as wide as
    the others leave the `free` (p,) parameters open; those that stand at the end of their step are
    held there.

    With the residual e at `d`, Jacobian J, weight κ (o,) and the others' precision P = `train`
    (p, p), the prediction of a cell has the covariance 1/κ + J P⁻¹ Jᵀ. By Woodbury's identity the
    log density changes by ½ κ² h·(P + κG)⁻¹h - ½ log det(1 + κ P⁻¹G), h = Jᵀe, G = JᵀJ.
    """
    out = np.zeros(left.n.shape)
    gram, train = left.G[..., free, :][..., free], train[np.ix_(free, free)]
    leverage = kappa * np.einsum("uoij,ji->uo", gram, np.linalg.inv(train))
    at = np.nonzero(leverage > NEGLIGIBLE)
    weight = kappa[at[1]]
    big = weight[:, None, None] * gram[at]
    h = (weight[:, None] * (left.g[at] - left.G[at] @ d))[:, free]
    wide = train + big
    gain = np.einsum("ni,ni->n", h, np.linalg.solve(wide, h[..., None])[..., 0])
    spread = np.linalg.slogdet(wide)[1] - np.linalg.slogdet(train)[1]
    out[at] = 0.5 * (gain - spread)
    return out


def log_score(fitter: Fitter, error: Array, n: Array, mean: Array) -> Array:
    """Held-out log score (u, o) of sums of squares (u, o) given training mean squares (o,)."""
    inflated = np.maximum(mean, 1.0)
    return np.asarray(
        -0.5 * fitter.likelihood.efficiency * (error / inflated + n * np.log(inflated))
    )


def held_out(
    fitter: Fitter,
    quad: Quadratic,
    space: Space,
    v: Array,
    ways: Sequence[Array],
    reach: Array | None = None,
) -> tuple[Array, Array]:
    """Held-out score per unit and observable (u, o) over all ways of leaving out, and the first's
    fold parameters (folds, p).
    """
    total = np.zeros((fitter.problem.n_units, len(fitter.problem.observables)))
    fold_v: list[Array] = []
    everything = summed(quad)
    low, high = box(space, v, reach)
    for index, way in enumerate(ways):
        for fold in range(int(way.max()) + 1):
            out = way == fold
            left = quad.of(out)
            rest = everything.without(summed(left))
            d, mean = refit(fitter, rest, v, low, high)
            kappa = fitter.likelihood.kappa(mean)
            train = np.tensordot(kappa, rest.G, 1) + np.eye(len(space))
            free = (d > low) & (d < high)
            score = log_score(fitter, left.error(d), left.n, mean)
            total[out] += (score + open_parameters(left, d, kappa, train, free)) / len(ways)
            if index == 0:
                fold_v.append(v + d)
    return total, np.array(fold_v)


def reach(fit: Fit) -> Array:
    """How far from a fit (p,) its linearisation is believed: anywhere while its spread is not
    known.
    """
    return FAR * fit.sd + 0.02 if fit.sd.size else np.full(len(fit.space), np.inf)


def cross_validate(fitter: Fitter, fit: Fit, ways: Sequence[Array]) -> Scored:
    """Held-out score of a fitted hypothesis."""
    quad = fitter.whitened(fit).products
    total, fold_v = held_out(fitter, quad, fit.space, fit.v, ways, reach(fit))
    return Scored(total, fold_v)


def fixed(fitter: Fitter, prediction: Array) -> Array:
    """Score (u, o) of a prediction that is given."""
    problem = fitter.problem
    z = fitter.noise.whiten(problem.y - prediction)
    weight, mean = fitter.likelihood.weights(z)
    error, n = problem.per_unit(weight * z**2), problem.per_unit(np.ones(problem.size))
    return log_score(fitter, error, n, mean)


def block_sums(problem: Problem, per_unit: Array) -> Array:
    """Unit scores summed over each block where there are enough blocks, else left per unit."""
    if len(problem.blocks) < ENOUGH:
        return per_unit
    return np.asarray(
        np.bincount(problem.block_of_unit, per_unit, minlength=len(problem.blocks)), float
    )


def difference(problem: Problem, better: Array, worse: Array) -> tuple[float, float]:
    """Total score difference and its standard error over blocks."""
    d = block_sums(problem, better - worse)
    return float(d.sum()), float(np.sqrt(d.size) * np.std(d, ddof=1)) if d.size > 1 else np.inf


def bootstrap(blocks: int, seed: int) -> Array:
    """Weights (draws, blocks) of a Bayesian bootstrap (Rubin 1981), 1 on average."""
    return np.random.default_rng(seed).dirichlet(np.ones(blocks), DRAWS) * blocks


def sureness(problem: Problem, better: Array, worse: Array, seed: int) -> float:
    """Probability that the first of two hypotheses with unit scores (u,) predicts better: of what
    all blocks agree on one is sure, however unlike their gains are.
    """
    d = block_sums(problem, better - worse)
    return float(np.mean(bootstrap(d.size, seed) @ d > 0.0))


def weights(problem: Problem, scores: list[Array], log_prior: Array, seed: int) -> Array:
    """Pseudo-BMA+ weights (m,) of hypotheses with unit scores (u,) each, in nats that count."""
    table = np.array([block_sums(problem, s) for s in scores])
    logits = bootstrap(table.shape[1], seed) @ table.T + log_prior
    logits -= logits.max(1, keepdims=True)
    each = np.exp(logits)
    return np.asarray((each / each.sum(1, keepdims=True)).mean(0))
