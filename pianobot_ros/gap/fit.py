"""Maximum a posteriori fits of a hypothesis: all nuisance parameters together with the effects' own.

Levenberg-Marquardt on whitened residuals with finite differences. Each observable enters with a concentrated likelihood (its
scale is at least its noise, more where the hypothesis cannot reach the noise), so that one signal that nobody can explain
does not bend all parameters; single outliers are Huber-weighted. The Jacobian of the nuisance parameters is handed on from
fit to fit and kept current by Broyden's rank-one update, which is what makes a large library affordable.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from pianobot_ros.gap.errors import SimulationFailed
from pianobot_ros.gap.noise import NoiseModel
from pianobot_ros.gap.problem import Problem, Request
from pianobot_ros.gap.quadratic import Quadratic, quadratic, solve_map, summed
from pianobot_ros.gap.space import Space
from pianobot_ros.gap.types import Array

HUBER = 4.0
HOPS = (-3.0, -1.0, -0.3, 0.3, 1.0, 3.0)
"""How far to look for a lower valley, in prior standard deviations."""
EXACT_TRIES = 5
"""Dampings tried with a fresh Jacobian: contacts that open and close make the valley's floor rough, so steps must be short."""


@dataclass(frozen=True)
class Fit:
    """A fitted hypothesis: `v` (p,) in prior units, flat `prediction` (size,), its `jacobian` (size, p) and cost."""

    effects: tuple[str, ...]
    space: Space
    v: Array
    prediction: Array
    jacobian: Array
    cost: float
    sd: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def values(self) -> dict[str, float]:
        """Parameter values by name."""
        return self.space.decode(self.v)

    @property
    def name(self) -> str:
        """Effects joined by "+", or "parameters"."""
        return "+".join(self.effects) or "parameters"


@dataclass(frozen=True)
class Whitened:
    """Whitened residual and Jacobian of a fit, with Huber weights, ready for quadratics."""

    z: Array
    jacobian: Array
    weight: Array


class Fitter:
    """Fits hypotheses to one problem under one noise model."""

    def __init__(self, problem: Problem, noise: NoiseModel) -> None:
        self.problem, self.noise = problem, noise
        self.count = np.bincount(problem.obs_of[problem.mask], minlength=len(problem.observables)).astype(float)
        self.efficiency = np.ones(len(problem.observables))
        self._samples = {o: np.flatnonzero((problem.obs_of == o) & problem.mask) for o in problem.present}

    def space(self, effects: tuple[str, ...]) -> Space:
        """Nuisances first, then each effect's parameters."""
        extra = [p for e in effects for p in self.problem.effects[e].parameters]
        return Space((*self.problem.parameters, *extra))

    # -- likelihood -----------------------------------------------------------------------------------------------------
    def weights(self, z: Array) -> tuple[Array, Array]:
        """Huber weights (size,) and weighted mean squares per observable (o,)."""
        weight = np.where(self.problem.mask, 1.0, 0.0)
        mean = np.zeros(self.count.size)
        for o in self.problem.present:
            use = self._samples[o]
            part = z[use]
            scale = max(1.0, 1.4826 * float(np.median(np.abs(part))), 0.3 * float(np.sqrt(np.mean(part**2))))
            w = np.minimum(1.0, HUBER * scale / np.maximum(np.abs(part), 1e-12))
            weight[use] = w
            mean[o] = float(np.mean(w * part**2))
        return weight, mean

    def data_cost(self, mean: Array) -> float:
        """Concentrated negative log likelihood of mean squares per observable (o,)."""
        rho = np.where(mean <= 1, mean, 1 + np.log(np.maximum(mean, 1)))
        return float(0.5 * np.sum(self.efficiency * self.count * rho))

    def kappa(self, mean: Array) -> Array:
        """Weight of each observable's sum of squares (o,)."""
        return self.efficiency / np.maximum(mean, 1.0)

    def cost(self, prediction: Array, v: Array) -> float:
        """Negative log posterior of a prediction."""
        z = self.noise.whiten(self.problem.y - prediction)
        return self.data_cost(self.weights(z)[1]) + 0.5 * float(v @ v)

    def cost_at(self, effects: tuple[str, ...], space: Space, v: Array) -> float:
        """Negative log posterior of parameters (p,); infinite where the twin cannot simulate them."""
        try:
            return self.cost(self.problem.predict(space.decode(v), effects), v)
        except SimulationFailed:
            return np.inf

    def set_efficiency(self, prediction: Array) -> None:
        """Effective share of independent samples per observable.

        Whitened residuals that are no larger than their noise need no correction: the noise model already holds their
        correlation. Beyond it, the misfit's own autocorrelation counts, the more the larger the misfit.
        """
        z = self.noise.whiten(self.problem.y - prediction)
        mean = self.weights(z)[1]
        for o in self.problem.present:
            raw = self._efficiency(o, z)
            self.efficiency[o] = raw + (1.0 - raw) / max(1.0, float(mean[o]))

    def _efficiency(self, o: int, z: Array) -> float:
        if self.problem.observables[o].kind == "event":
            return 1.0
        numerator: dict[int, float] = {}
        denominator = 0.0
        length = []
        for c in self.problem.cells:
            if c.observable != o:
                continue
            part = z[c.start : c.stop][self.problem.mask[c.start : c.stop]]
            if part.size < 4:
                continue
            length.append(part.size)
            denominator += float(part @ part)
            spectrum = np.abs(np.fft.rfft(part, 2 * part.size)) ** 2
            auto = np.fft.irfft(spectrum)[: part.size // 2]
            for k, value in enumerate(auto):
                numerator[k] = numerator.get(k, 0.0) + float(value)
        if denominator <= 0 or not length:
            return 1.0
        total = 1.0
        for k in range(1, len(numerator)):
            rho = numerator[k] / denominator
            if rho < 0.02:
                break
            total += 2 * rho
        return float(min(1.0, max(1.0 / total, 4.0 / np.median(length))))

    # -- derivatives ----------------------------------------------------------------------------------------------------
    def jacobian(self, space: Space, v: Array, effects: tuple[str, ...], base: Array,
                 columns: list[int] | None = None, step: float = 0.1) -> Array:  # fmt: skip
        """Forward differences of the flat prediction (size, p) for `columns` (default: all; others are 0)."""
        columns = list(range(len(space))) if columns is None else columns
        requests: list[Request] = []
        steps = []
        for j in columns:
            h = step if v[j] + step <= space.high[j] else -step
            if v[j] + h < space.low[j]:
                h = 0.5 * (space.high[j] - v[j])
            w = v.copy()
            w[j] += h
            steps.append(w[j] - v[j])
            requests.append((space.decode(w), effects))
        out = np.zeros((self.problem.size, len(space)))
        for j, h, result in zip(columns, steps, self.problem.predict_many(requests), strict=True):
            if not isinstance(result, Exception) and h != 0:
                out[:, j] = (result - base) / h
        return out

    def whitened(self, fit: Fit) -> Whitened:
        """Whitened residual and Jacobian of a fit."""
        z = self.noise.whiten(self.problem.y - fit.prediction)
        weight, _ = self.weights(z)
        return Whitened(z, self.noise.whiten(fit.jacobian), weight)

    def quadratic(self, white: Whitened) -> Quadratic:
        """Per unit and observable."""
        p = self.problem
        return quadratic(white.z, white.jacobian, p.runs, (p.n_units, len(p.observables)), white.weight)

    # -- the fit --------------------------------------------------------------------------------------------------------
    def start(self, effects: tuple[str, ...], v: Array, jacobian: Array | None = None) -> Fit:
        """An unfitted hypothesis at `v`; its Jacobian may be partly known (columns of zeros are computed)."""
        space = self.space(effects)
        v = space.clip(v)
        prediction = self.problem.predict(space.decode(v), effects)
        if jacobian is None:
            jacobian = self.jacobian(space, v, effects, prediction)
        elif jacobian.shape[1] < len(space):
            known = jacobian.shape[1]
            fresh = self.jacobian(space, v, effects, prediction, list(range(known, len(space))))
            fresh[:, :known] = jacobian
            jacobian = fresh
        return Fit(effects, space, v, prediction, jacobian, self.cost(prediction, v))

    def refine(self, fit: Fit, iterations: int, fresh_columns: list[int] | None = None, tolerance: float = 0.5) -> Fit:
        """Levenberg-Marquardt from `fit`; `fresh_columns` are recomputed by differences after every accepted step.

        The other columns are carried along by Broyden's update. Where that leads no further, the whole Jacobian is computed
        anew; the fit has converged when it leads no further then either. Hypotheses are compared by a few nats: a fit that
        stops early would lose to one that happened to stop later.
        """
        fit = replace(fit, cost=self.cost(fit.prediction, fit.v))  # noise or efficiencies may have changed since
        tolerance += 1e-4 * max(fit.cost, 0.0)  # what differences between hypotheses are judged by grows alike
        damping, rejected, exact = 1e-3, 0, False
        for _ in range(iterations):
            proposal = self._step(fit, damping)
            gain = -np.inf if proposal is None else fit.cost - proposal[2]
            if proposal is not None and gain > 0:
                v, prediction, cost = proposal
                fit = replace(fit, v=v, prediction=prediction, cost=cost,
                              jacobian=self._update(fit, v, prediction, fresh_columns))  # fmt: skip
                damping, rejected = max(damping / 5, 1e-5), 0
                exact = exact and gain < tolerance
            elif proposal is not None:
                damping, rejected = damping * 20, rejected + 1
            if gain > tolerance or 0 < rejected < (EXACT_TRIES if exact else 2):
                continue
            if exact:
                break
            fit = replace(fit, jacobian=self.jacobian(fit.space, fit.v, fit.effects, fit.prediction, step=0.05))
            damping, rejected, exact = 1e-3, 0, True
        return replace(fit, sd=self.deviation(fit))

    def hop(self, fit: Fit, columns: list[int], iterations: int, rounds: int = 2, tolerance: float = 2.0) -> Fit:
        """Leave a local optimum: try each of `columns` at a distance, all others as they are, and refine from the best.

        Laws with contacts that open and close, or with terms that vanish at a bound, have several.
        """
        for _ in range(rounds):
            trials = []
            for j in columns:
                for far in HOPS:
                    v = fit.v.copy()
                    v[j] = np.clip(v[j] + far, fit.space.low[j], fit.space.high[j])
                    trials.append(v)
            results = self.problem.predict_many([(fit.space.decode(v), fit.effects) for v in trials])
            costs = [
                np.inf if isinstance(r, Exception) else self.cost(r, v) for r, v in zip(results, trials, strict=True)
            ]
            best = int(np.argmin(costs))
            if costs[best] > fit.cost - tolerance:
                break
            fit = self.refine(self.start(fit.effects, trials[best]), iterations)
        return fit

    def _normal(self, fit: Fit) -> tuple[Array, Array]:
        """Normal equations, summed run by run: small products stay in one thread and in the cache."""
        white = self.whitened(fit)
        kappa = self.kappa(self.weights(white.z)[1])
        part = summed(self.quadratic(white))
        return np.tensordot(kappa, part.G, 1), np.asarray(kappa @ part.g)

    def _step(self, fit: Fit, damping: float) -> tuple[Array, Array, float] | None:
        big, g = self._normal(fit)
        scale = np.diag(big).copy()
        d = solve_map(big + damping * np.diag(scale + 1.0), g, fit.v, fit.space.low - fit.v, fit.space.high - fit.v)
        if float(np.max(np.abs(d), initial=0.0)) < 1e-4:
            return None
        d = d * min(1.0, 6.0 / max(float(np.max(np.abs(d))), 1e-12))
        v = fit.space.clip(fit.v + d)
        try:
            prediction = self.problem.predict(fit.space.decode(v), fit.effects)
        except SimulationFailed:
            return v, fit.prediction, np.inf
        return v, prediction, self.cost(prediction, v)

    def _update(self, fit: Fit, v: Array, prediction: Array, fresh_columns: list[int] | None) -> Array:
        d = v - fit.v
        jacobian = fit.jacobian
        live = np.where(np.einsum("ij->j", np.abs(jacobian[:: max(1, len(jacobian) // 5000)])) > 0, d, 0.0)
        length = float(live @ live)
        if length > 1e-6:
            missed = prediction - fit.prediction - jacobian @ d
            jacobian = jacobian + np.outer(missed, live / length)
        elif fresh_columns:
            jacobian = jacobian.copy()
        if fresh_columns:
            fresh = self.jacobian(fit.space, v, fit.effects, prediction, fresh_columns)
            jacobian[:, fresh_columns] = fresh[:, fresh_columns]
        return np.asarray(jacobian)

    def deviation(self, fit: Fit) -> Array:
        """Posterior standard deviation (p,) of the parameters, from the fit's own level of misfit."""
        big, _ = self._normal(fit)
        covariance = np.linalg.pinv(big + np.eye(len(fit.space)), hermitian=True)
        return np.asarray(np.sqrt(np.maximum(np.diag(covariance), 0.0)))
