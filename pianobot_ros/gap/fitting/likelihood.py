"""How likely a prediction is: whitened residuals, Huber-weighted, with one concentrated scale for
each observable.
"""

from __future__ import annotations

import copy

import numpy as np

from pianobot_ros.gap.fitting.space import Space
from pianobot_ros.gap.floor.noise import NoiseModel
from pianobot_ros.gap.problem.constants import HUBER, NEGLIGIBLE, OF_MEDIAN
from pianobot_ros.gap.problem.errors import SimulationFailed
from pianobot_ros.gap.problem.problem import Problem
from pianobot_ros.gap.problem.types import Array


class Likelihood:
    """Of one problem under one noise model. `efficiency` (o,): effective share of independent
    samples, all of them or as in the misfit of a prediction `at` (size,); `count` (o,): samples
    that are compared.
    """

    def __init__(self, problem: Problem, noise: NoiseModel, at: Array | None = None) -> None:
        self.problem, self.noise = problem, noise
        self.count = np.bincount(
            problem.obs_of[problem.mask], minlength=len(problem.observables)
        ).astype(float)
        samples = {o: np.flatnonzero((problem.obs_of == o) & problem.mask) for o in problem.present}
        # an event of one strike is in one fold: without it nothing of it is judged
        self._samples = {o: use for o, use in samples.items() if use.size}
        self.efficiency = (
            np.ones(len(problem.observables)) if at is None else self._efficiencies(at)
        )

    def only(self, observable: int) -> Likelihood:
        """That of one observable, as if nothing else had been measured."""
        out = copy.copy(self)
        out.efficiency = np.where(np.arange(self.count.size) == observable, self.efficiency, 0.0)
        return out

    def weights(self, z: Array) -> tuple[Array, Array]:
        """Huber weights (size,) and weighted mean squares per observable (o,)."""
        weight = np.where(self.problem.mask, 1.0, 0.0)
        mean = np.zeros(self.count.size)
        for o, use in self._samples.items():
            part = z[use]
            scale = max(
                1.0,
                OF_MEDIAN * float(np.median(np.abs(part))),
                0.3 * float(np.sqrt(np.mean(part**2))),
            )
            far = HUBER * scale
            w = far / np.maximum(np.abs(part), far)
            weight[use] = w
            mean[o] = float(np.mean(w * part**2))
        return weight, mean

    def data_cost(self, mean: Array) -> float:
        """Concentrated negative log likelihood of mean squares per observable (o,)."""
        return float(self.costs(mean).sum())

    def costs(self, mean: Array) -> Array:
        """The same by observable (o,)."""
        rho = np.where(mean <= 1, mean, 1 + np.log(np.maximum(mean, 1)))
        return np.asarray(0.5 * self.efficiency * self.count * rho)

    def costs_of(self, prediction: Array) -> Array:
        """Negative log likelihood of a prediction by observable (o,)."""
        z = self.noise.whiten(self.problem.y - prediction)
        return self.costs(self.weights(z)[1])

    def kappa(self, mean: Array) -> Array:
        """Weight of each observable's sum of squares (o,)."""
        return self.efficiency / np.maximum(mean, 1.0)

    def cost(self, prediction: Array, v: Array) -> float:
        """Negative log posterior of a prediction."""
        return float(self.costs_of(prediction).sum()) + 0.5 * float(v @ v)

    def cost_at(self, effects: tuple[str, ...], space: Space, v: Array) -> float:
        """Negative log posterior of parameters (p,); infinite where the twin cannot simulate
        them.
        """
        try:
            return self.cost(self.problem.predict(space.decode(v), effects), v)
        except SimulationFailed:
            return np.inf

    def _efficiencies(self, prediction: Array) -> Array:
        """Effective share of independent samples per observable (o,).

        Whitened residuals that are no larger than their noise need no correction: the noise model
        already holds their correlation. Beyond it, the misfit's own autocorrelation counts, the
        more the larger the misfit.
        """
        z = self.noise.whiten(self.problem.y - prediction)
        mean = self.weights(z)[1]
        out = np.ones(len(self.problem.observables))
        for o in self._samples:
            raw = self._efficiency(o, z)
            out[o] = raw + (1.0 - raw) / max(1.0, float(mean[o]))
        return out

    def _efficiency(self, o: int, z: Array) -> float:
        if self.problem.observables[o].kind == "event":
            return 1.0
        parts = [self.problem.judged(c, z) for c in self.problem.cells_of(o)]
        parts = [x for x in parts if x.size >= 4]
        denominator = sum(float(x @ x) for x in parts)
        if denominator <= 0:
            return 1.0
        length = [x.size for x in parts]
        numerator = np.zeros(max(length) // 2)
        for x in parts:
            spectrum = np.abs(np.fft.rfft(x, 2 * x.size)) ** 2
            numerator[: x.size // 2] += np.fft.irfft(spectrum)[: x.size // 2]
        rho = numerator[1:] / denominator
        total = 1.0 + 2.0 * float(rho[: np.argmax(np.append(rho, 0.0) < NEGLIGIBLE)].sum())
        return float(min(1.0, max(1.0 / total, 4.0 / np.median(length))))
