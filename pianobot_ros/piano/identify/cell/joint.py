"""One fit of everything that is not known, to everything that was measured.

Maximum a posteriori by Gauss-Newton with Gaussian priors. Parameters are counted in standard
deviations of their priors. Two things keep the answer honest where the model is wrong. Effects that
the model leaves out enter with their signatures, linear, and are integrated out (Kennedy and
O'Hagan 2001: model inadequacy as a part of the model). And what still is left in a signal counts as
its noise, whole groups of repeats being the independent data (cluster-robust covariance, Liang and
Zeger 1986), with Student's t for their number. A fit that leaves more than is usual misses
something that no signature has: then all intervals are as many times as wide (Birge 1932).

Knows no piano: a :class:`FitProblem` says what is measured and predicts it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from pianobot_ros.cell.arrays import Array

__all__ = ["Data", "FitProblem", "Joint", "fit_joint"]

Integers = NDArray[np.int64]

TAIL = 4.0  # degrees of freedom of Student's t by which single samples are weighted
FEWEST = 3  # degrees of freedom of an interval at least
AT_FLOOR = 3.0  # samples at the floor beside which a few say little about their scatter
SMALL_STEP = 0.04  # standard deviations of a prior: a smaller step ends the fit
CONTENT = 0.9  # content of an interval


@dataclass(frozen=True)
class Data:
    """What was measured: ``value`` (n,), NaN where it is missing; by sample its ``channel`` and
    ``group`` (n,) and its ``weight`` (n,), under 1 where neighbours say nearly the same; ``floor``
    (channels,) the noise of a sample; ``usual`` (channels,) what a fit leaves of a channel where
    nothing is missing, infinite where that is not known; ``heavy`` (channels,) whether samples may
    be strays.
    """

    value: Array
    channel: Integers
    group: Integers
    weight: Array
    floor: Array
    usual: Array
    heavy: NDArray[np.bool_]


class FitProblem(Protocol):
    """What is fitted: p parameters at coordinates (p,), and q effects that the model lacks.
    ``tolerance`` (p,): what the model's own simplicity makes of each coordinate, standard
    deviation.
    """

    data: Data
    tolerance: Array

    def predict(self, x: Array) -> Array:
        """Predicted values (n,) at coordinates x (p,); NaN where nothing can be said."""
        ...

    def slopes(self, x: Array) -> Array:
        """Derivative (n, p) of the prediction by the coordinates."""
        ...

    def signatures(self, x: Array) -> Array:
        """What one standard deviation of each missing effect adds to the prediction, (n, q)."""
        ...


@dataclass(frozen=True)
class Joint:
    """Result of :func:`fit_joint`: ``x`` (p,) coordinates; ``covariance`` (p, p) of them, effects
    integrated out; ``effects`` (q,) their coordinates; ``noise`` (channels,); ``width`` the factor
    from a standard deviation to half of the 90 % interval; ``cost``; ``information`` (p + q, p + q)
    of data and priors, which says what another recording would add; ``birge``, how many times what
    is usual the fit leaves, at least 1, which ``width`` holds.
    """

    x: Array
    covariance: Array
    effects: Array
    noise: Array
    width: float
    cost: float
    information: Array
    birge: float

    def half(self, direction: Array) -> float:
        """Half width of the 90 % interval of a combination (p,) of coordinates."""
        return float(self.width * np.sqrt(max(float(direction @ self.covariance @ direction), 0.0)))


def fit_joint(problem: FitProblem, start: Array, *, iterations: int = 9) -> Joint:
    """Fit from coordinates ``start`` (p,)."""
    x, best = start.astype(float), np.inf
    data, p = problem.data, len(start)
    noise = 3.0 * data.floor
    predicted = problem.predict(x)
    signatures = problem.signatures(x)
    w = np.concatenate([x, np.zeros(signatures.shape[1])])
    damping = 1e-3
    for i in range(iterations):
        if i == 3:  # signatures change little along the way; renew them once near the end
            signatures = problem.signatures(x)
        jacobian = np.hstack([problem.slopes(x), signatures])
        residual = _residual(data, predicted + signatures @ w[p:])
        noise = _noise(data, residual, noise)
        weight = _weights(data, residual, noise)
        clean = np.where(np.isfinite(jacobian), jacobian, 0.0)
        normal = (clean * weight[:, None]).T @ clean
        gradient = clean.T @ (weight * residual) - w
        best = _cost(data, residual, noise, w)
        moved = False
        for _ in range(4):
            step = np.linalg.solve(normal + (1.0 + damping) * np.eye(len(w)), gradient)
            step *= min(1.0, 1.5 / max(float(np.abs(step[:p]).max()), 1e-12))
            new = w + step
            ahead = problem.predict(new[:p])
            cost = _cost(data, _residual(data, ahead + signatures @ new[p:]), noise, new)
            if cost < best:
                w, x, predicted, damping, moved = new, new[:p], ahead, damping / 10, True
                break
            damping = max(10 * damping, 0.1)
        if not moved or (i > 3 and float(np.abs(step).max()) < SMALL_STEP):
            break
    return _finish(problem, w, p, predicted, signatures, noise)


def _finish(
    problem: FitProblem, w: Array, p: int, predicted: Array, signatures: Array, noise: Array
) -> Joint:
    data = problem.data
    residual = _residual(data, predicted + signatures @ w[p:])
    noise = _noise(data, residual, noise)
    weight = _weights(data, residual, noise)
    jacobian = np.hstack([problem.slopes(w[:p]), signatures])
    clean = np.where(np.isfinite(jacobian), jacobian, 0.0)
    information = (clean * weight[:, None]).T @ clean + np.eye(len(w))
    inverse = np.linalg.inv(information)
    groups = int(data.group.max()) + 1 if data.group.size else 0
    covariance = inverse
    if groups > FEWEST:
        scores = np.zeros((groups, len(w)))
        np.add.at(scores, data.group, clean * (weight * residual)[:, None])
        scores -= scores.mean(axis=0)
        meat = scores.T @ scores * groups / (groups - 1) + np.eye(len(w))
        robust = inverse @ meat @ inverse
        # never surer than either: a correlation matrix of the robust one, with the larger spread
        scale = np.sqrt(np.maximum(np.diag(inverse) / np.diag(robust), 1.0))
        covariance = robust * np.outer(scale, scale)
    freedom = max(groups - 1, FEWEST)
    birge = max(1.0, float(np.max(noise / data.usual)))
    return Joint(
        w[:p],
        covariance[:p, :p] + np.diag(problem.tolerance**2),
        w[p:],
        noise,
        birge * float(student.ppf(0.5 + CONTENT / 2, freedom)),
        _cost(data, residual, noise, w),
        information,
        birge,
    )


def _residual(data: Data, predicted: Array) -> Array:
    """Measured less predicted; 0 where either is missing."""
    return np.nan_to_num(data.value - predicted, nan=0.0)


def _noise(data: Data, residual: Array, before: Array) -> Array:
    """Scatter of each channel (channels,): never under its floor, falling at most by half at a
    time.
    """
    noise = data.floor.copy()
    for c in range(len(noise)):
        own = (data.channel == c) & np.isfinite(data.value)
        if own.any():
            squares = residual[own] ** 2
            if data.heavy[c]:
                squares = squares * (TAIL + 1) / (TAIL + squares / before[c] ** 2)
            count = float(data.weight[own].sum())
            mean = (float(data.weight[own] @ squares) + AT_FLOOR * noise[c] ** 2) / (
                count + AT_FLOOR
            )
            noise[c] = max(noise[c], float(np.sqrt(mean)), 0.5 * before[c] if count else 0.0)
    return np.asarray(noise)


def _weights(data: Data, residual: Array, noise: Array) -> Array:
    sd = noise[data.channel]
    weight = data.weight / sd**2
    stray = (TAIL + 1) / (TAIL + (residual / sd) ** 2)
    weight = np.where(data.heavy[data.channel], weight * stray, weight)
    return np.asarray(np.where(np.isfinite(data.value), weight, 0.0))


def _cost(data: Data, residual: Array, noise: Array, w: Array) -> float:
    """Negative logarithm of the posterior, up to a constant."""
    r2 = (residual / noise[data.channel]) ** 2
    loss = np.where(data.heavy[data.channel], (TAIL + 1) / 2 * np.log1p(r2 / TAIL), 0.5 * r2)
    loss = loss + np.log(noise[data.channel])
    loss = np.where(np.isfinite(data.value), loss * data.weight, 0.0)
    return float(loss.sum() + 0.5 * w @ w)
