"""Maximum a posteriori fits of a hypothesis: all nuisance parameters together with the effects'
own.

Levenberg-Marquardt on whitened residuals with finite differences. Each observable enters with a
concentrated likelihood (its scale is at least its noise, more where the hypothesis cannot reach the
noise), so that one signal that nobody can explain does not bend all parameters; single outliers are
Huber-weighted. The Jacobian of the nuisance parameters is handed on from fit to fit and kept
current by Broyden's rank-one update in every observable, which is what makes a large library
affordable.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from pianobot_ros.gap.fitting.derivatives import differences
from pianobot_ros.gap.fitting.likelihood import Likelihood
from pianobot_ros.gap.fitting.quadratic import Quadratic, quadratic, solve_map, summed
from pianobot_ros.gap.fitting.space import Space
from pianobot_ros.gap.floor.noise import NoiseModel
from pianobot_ros.gap.problem.constants import (
    DIFFERENCES,
    EXACT_TRIES,
    FAITHFUL,
    FAR,
    SMALL,
    TINY,
)
from pianobot_ros.gap.problem.errors import SimulationFailed
from pianobot_ros.gap.problem.problem import Index, Problem
from pianobot_ros.gap.problem.types import Array


@dataclass(frozen=True)
class Fit:
    """A fitted hypothesis: `v` (p,) in prior units, flat `prediction` (size,), its `jacobian`
    (size, p) and cost.
    """

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

    def beyond(self, base: Fit) -> list[int]:
        """Columns of the parameters that it has beyond those of `base`, an effect's size first."""
        return list(range(len(base.space), len(self.space)))


@dataclass(frozen=True)
class Whitened:
    """Whitened residual and Jacobian of a fit, with Huber weights and weighted mean squares by
    observable (o,); and the products of their columns per unit and observable.
    """

    z: Array
    jacobian: Array
    weight: Array
    mean: Array
    products: Quadratic


@dataclass(frozen=True)
class _Step:
    """A step's parameters (p,), prediction (size,) and cost; the cost that was `expected` of it, by
    the Jacobian.
    """

    v: Array
    prediction: Array
    cost: float
    expected: float


class Fitter:
    """Fits hypotheses to one problem under one noise model, with as many independent samples as the
    misfit of a prediction `at` (size,) leaves.
    """

    def __init__(self, problem: Problem, noise: NoiseModel, at: Array | None = None) -> None:
        self.problem, self.noise = problem, noise
        self.likelihood = Likelihood(problem, noise, at)
        self._observables = [np.flatnonzero(problem.obs_of == o) for o in problem.present]
        self._latest: tuple[Fit, Whitened] | None = None

    def __getstate__(self) -> dict[str, object]:
        return self.__dict__ | {"_latest": None}  # as large as all the rest of a kept study

    def only(self, observable: int) -> Fitter:
        """The same, as if nothing but one observable had been measured."""
        out = copy.copy(self)
        out.likelihood, out._latest = self.likelihood.only(observable), None
        return out

    def space(self, effects: tuple[str, ...]) -> Space:
        """Nuisances first, then each effect's parameters."""
        extra = [p for e in effects for p in self.problem.effects[e].parameters]
        return Space((*self.problem.parameters, *extra))

    def whitened(self, fit: Fit) -> Whitened:
        """Whitened residual and Jacobian of a fit; those of the latest are kept, since each damping
        of a step and each question to a fit asks for them.
        """
        if self._latest is not None:
            of, known = self._latest
            if of.prediction is fit.prediction and of.jacobian is fit.jacobian:
                return known
        p, z = self.problem, self.noise.whiten(self.problem.y - fit.prediction)
        jacobian, (weight, mean) = self.noise.whiten(fit.jacobian), self.likelihood.weights(z)
        shape = p.n_units, len(p.observables)
        products = quadratic(z, jacobian, p.runs, shape, weight)
        white = Whitened(z, jacobian, weight, mean, products)
        self._latest = fit, white
        return white

    def cost(self, fit: Fit) -> float:
        """What a fit costs, as costs are counted here: noise or efficiencies may have changed since
        it was made.
        """
        return self.likelihood.cost(fit.prediction, fit.v)

    def start(self, effects: tuple[str, ...], v: Array, jacobian: Array | None = None) -> Fit:
        """An unfitted hypothesis at `v`; the first columns of its Jacobian may be known."""
        space = self.space(effects)
        v = space.clip(v)
        prediction = self.problem.predict(space.decode(v), effects)
        known = 0 if jacobian is None else jacobian.shape[1]
        begun = np.zeros((self.problem.size, len(space)))
        begun[:, :known] = 0.0 if jacobian is None else jacobian
        cost = self.likelihood.cost(prediction, v)
        fit = Fit(effects, space, v, prediction, begun, cost)
        return self._renewed(fit, list(range(known, len(space))), SMALL)

    def begun(
        self, effects: tuple[str, ...], v: Array, jacobian: Array | None = None
    ) -> Fit | None:
        """What :meth:`start` returns; None where the twin cannot simulate it: a law may run away at
        values that were fitted with another.
        """
        try:
            return self.start(effects, v, jacobian)
        except SimulationFailed:
            return None

    def refine(self, fit: Fit, iterations: int, columns: list[int] | None = None) -> Fit:
        """Levenberg-Marquardt from `fit`, with the Jacobian carried along by Broyden's update.

        Where that leads no further, `columns` of it (default: all) are computed anew by
        differences, over each of :data:`DIFFERENCES` in turn; the fit has converged when it leads
        no further by any. Given `columns` are computed anew after every step that did not do what
        the Jacobian said: laws with jumps have no derivatives to carry along. Gains count down to
        :data:`SMALL` of what tells hypotheses apart: a fit that stops early would lose to one that
        happened to stop later.
        """
        fit = replace(fit, cost=self.cost(fit))
        tolerance = self._tolerance(fit)
        damping, rejected, exact = 1e-3, 0, 0
        for _ in range(iterations):
            step = self._step(fit, damping)
            if step is not None:
                gain = fit.cost - step.cost
                if gain > 0:
                    exact = exact if gain < tolerance else 0
                    fit = self._accepted(fit, step, columns, exact > 0)
                    damping, rejected = max(damping / 5, 1e-5), 0
                else:
                    damping, rejected = damping * 20, rejected + 1
                if gain > tolerance or 0 < rejected < (EXACT_TRIES if exact else 2):
                    continue
            if exact == len(DIFFERENCES):
                break
            fit = self._renewed(fit, columns, DIFFERENCES[exact])
            damping, rejected, exact = 1e-3, 0, exact + 1
        return replace(fit, sd=self.deviation(fit))

    def cheaper(self, fit: Fit, other: Fit) -> Fit:
        """The `other` of two fits where it costs less by what counts."""
        least = self.cost(fit) - self._tolerance(fit)
        return other if self.cost(other) < least else fit

    def _tolerance(self, fit: Fit) -> float:
        """What another fit must cost less to be a better one."""
        c = self.noise.options.calibration
        return SMALL * (c.temperature + c.law_precision * max(fit.cost, 0.0))

    def _renewed(self, fit: Fit, columns: list[int] | None, step: float) -> Fit:
        """A fit with `columns` of its Jacobian (default: all) computed anew over a `step`."""
        chosen = list(range(len(fit.space))) if columns is None else columns
        fresh = differences(
            self.problem, fit.space, fit.v, fit.prediction, fit.effects, chosen, step
        )
        renewed = fit.jacobian.copy()
        renewed[:, chosen] = fresh[:, chosen]
        return replace(fit, jacobian=renewed)

    def hop(self, fit: Fit, columns: list[int], iterations: int, rounds: int = 2) -> Fit:
        """Leave a local optimum: try each of `columns` a prior standard deviation up and down, and
        refine from the best. Laws with contacts that open and close, or with terms that vanish at a
        bound, have several.
        """
        for _ in range(rounds):
            steps = np.eye(fit.v.size)[columns]
            trials = [fit.space.clip(fit.v + d) for d in np.concatenate([-steps, steps])]
            results = self.problem.predict_many(
                [(fit.space.decode(v), fit.effects) for v in trials]
            )
            costs = [
                np.inf if isinstance(r, Exception) else self.likelihood.cost(r, v)
                for r, v in zip(results, trials, strict=True)
            ]
            best = int(np.argmin(costs))
            if costs[best] >= fit.cost - self._tolerance(fit):
                break
            fit = self.refine(self.start(fit.effects, trials[best]), iterations)
        return fit

    def _normal(self, white: Whitened) -> tuple[Array, Array, Quadratic]:
        """Normal equations, summed run by run: small products stay in one thread and in the
        cache; and what they are weighted from.
        """
        kappa = self.likelihood.kappa(white.mean)
        part = summed(white.products)
        return np.tensordot(kappa, part.G, 1), np.asarray(kappa @ part.g), part

    def _step(self, fit: Fit, damping: float) -> _Step | None:
        """A damped step; None where its Jacobian promises a small part of a nat, which moves no
        parameter by half of its standard deviation, so that it need not be simulated (as MINPACK
        ends; Moré 1978, Lecture Notes in Mathematics 630).
        """
        big, g, part = self._normal(self.whitened(fit))
        scale = np.diag(big).copy()
        d = solve_map(
            big + damping * np.diag(scale + 1.0),
            g,
            fit.v,
            fit.space.low - fit.v,
            fit.space.high - fit.v,
        )
        across = 2.0 * FAR  # from one end of what is believed of a parameter to the other
        d = d * min(1.0, across / max(float(np.max(np.abs(d), initial=0.0)), TINY))
        v = fit.space.clip(fit.v + d)
        expected = self.likelihood.data_cost(part.mean(v - fit.v)) + 0.5 * float(v @ v)
        if fit.cost - expected <= SMALL:
            return None
        try:
            prediction = self.problem.predict(fit.space.decode(v), fit.effects)
        except SimulationFailed:
            return _Step(v, fit.prediction, np.inf, expected)
        return _Step(v, prediction, self.likelihood.cost(prediction, v), expected)

    def _accepted(self, fit: Fit, step: _Step, columns: list[int] | None, exact: bool) -> Fit:
        """The fit after a step, its Jacobian by Broyden's update; `columns` of it by differences
        (default: none) unless the step did what the Jacobian said. An `exact` Jacobian stays, since
        the step that ends a fit is small: what the twin's own roughness adds to it, over its
        length, would be taken for a derivative.
        """
        if exact:
            return replace(fit, v=step.v, prediction=step.prediction, cost=step.cost)
        jacobian = _updated(
            fit.jacobian, step.v - fit.v, step.prediction - fit.prediction, self._observables
        )
        faithful = abs(step.cost - step.expected) < FAITHFUL * (fit.cost - step.cost)
        fit = replace(fit, v=step.v, prediction=step.prediction, cost=step.cost, jacobian=jacobian)
        return self._renewed(fit, columns, SMALL) if columns and not faithful else fit

    def deviation(self, fit: Fit) -> Array:
        """Posterior standard deviation (p,) of the parameters, from the fit's own level of
        misfit.
        """
        covariance = self._covariance(self.whitened(fit))
        return np.asarray(np.sqrt(np.maximum(np.diag(covariance), 0.0)))

    def gain(self, fit: Fit) -> Array:
        """What each sample of the residual moves the parameters of a fit by (size, p), in its unit
        and standard deviations of their priors.
        """
        white = self.whitened(fit)
        kappa = self.likelihood.kappa(white.mean)[self.problem.obs_of]
        weighted = white.jacobian * (kappa * white.weight)[:, None]
        return np.asarray(self.noise.unwhiten(weighted @ self._covariance(white)))

    def _covariance(self, white: Whitened) -> Array:
        big, _, _ = self._normal(white)
        return np.asarray(np.linalg.pinv(big + np.eye(len(big)), hermitian=True))


def _updated(jacobian: Array, d: Array, change: Array, observables: Iterable[Index]) -> Array:
    """Broyden's update of a Jacobian (size, p) by the ``change`` (size,) that a step ``d`` (p,)
    made, in each of the `observables` (its samples) by the parameters that it depends on: which it
    does not, stay so (Schubert 1970, Mathematics of Computation 24).
    """
    updated: Array = jacobian.copy()
    for own in observables:
        known = jacobian[own]
        live = np.where(known.any(0), d, 0.0)
        length = float(live @ live)
        if length > 1e-6:
            updated[own] += np.outer(change[own] - known @ d, live / length)
    return updated
