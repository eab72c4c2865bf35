"""The repeatability floor: what repeated blocks differ by although nothing was changed, and the
whitening of residuals by it.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from pianobot_ros.gap.floor.estimate import Estimates, estimates
from pianobot_ros.gap.floor.whitening.random_effects import inverse_root
from pianobot_ros.gap.floor.whitening.whiten import Whitener
from pianobot_ros.gap.problem.constants import SMALL, TINY
from pianobot_ros.gap.problem.layout import Index
from pianobot_ros.gap.problem.options import Options
from pianobot_ros.gap.problem.problem import Cell, Problem
from pianobot_ros.gap.problem.types import Array


class NoiseModel:
    """The `floor` of every observable (o,), in its own unit, and whitening of flat residuals.

    `inherited` (size,): deviation that each sample has from what was spliced in before it (see
    :mod:`~pianobot_ros.gap.floor.splice`; default: none); `rate` (size,): deviation of the rate
    of what of it changes faster than the signal does (default: none).
    """

    def __init__(
        self,
        problem: Problem,
        options: Options,
        estimates: Estimates,
        inherited: Array | None = None,
        rate: Array | None = None,
    ) -> None:
        self.problem, self.options, self.estimates = problem, options, estimates
        self.inherited = np.zeros(problem.size) if inherited is None else inherited
        self.rate = np.zeros(problem.size) if rate is None else rate
        count, noises = len(problem.observables), estimates.noises
        own = np.array([noises[o].floor if o in noises else 1.0 for o in range(count)])
        self._scale = np.hypot(own[problem.obs_of], self.inherited)
        squares = np.bincount(problem.obs_of[problem.mask], self._scale[problem.mask] ** 2, count)
        samples = np.bincount(problem.obs_of[problem.mask], minlength=count)
        self.floor = np.where(samples > 0, np.sqrt(squares / np.maximum(samples, 1)), own)

    @classmethod
    def by(cls, problem: Problem, residual: Array, options: Options) -> NoiseModel:
        """By the repeats of one residual (size,), with nothing inherited."""
        return cls(problem, options, estimates(problem, residual, options))

    @cached_property
    def _filter(self) -> Whitener:
        """Of all samples that are judged; whoever only measures gaps needs none."""
        filters: list[Whitener] = []
        problem = self.problem
        repeats = np.bincount(problem.condition_of_block)
        for c in problem.cells:
            noise = self.estimates.noises.get(c.observable)
            tolerance, tau_tol, keep = self.tolerance_of(c)
            if noise is None or not keep.size:
                continue
            at, t = keep + c.start, c.t[keep]
            # it is the same in all repeats, so it does not average out over them
            tolerance *= float(np.sqrt(repeats[problem.condition_of_block[c.block]]))
            if problem.observables[c.observable].kind == "event":
                filters.append(Whitener.of(t, np.hypot(noise.white, tolerance), (0.0, 1.0), at=at))
                continue
            y = problem.y[c.start : c.stop][keep]
            slope = np.abs(np.gradient(y)) if y.size > 1 else np.zeros(y.size)  # per sample
            white = np.hypot(
                np.maximum(noise.white, SMALL * tolerance), self.options.timing_tolerance * slope
            )
            filters.append(Whitener.of(t, white, noise.wander, (tolerance, tau_tol), at))
        return Whitener.joined(filters)

    @cached_property
    def _effects(self) -> list[tuple[slice, Array, Array]]:
        """Of each cell whose block has effects of its own: its samples, the directions A (n, k) as
        large as they vary, whitened, and M (k, k) with (1 + A Aᵀ)^(-1/2) = 1 - A M Aᵀ.
        """
        along, noises = self.estimates.directions, self.estimates.noises
        varying = {o: x.effects.deviation for o, x in noises.items() if x.effects is not None}
        if along is None or not varying:
            return []
        size = np.zeros((len(self.problem.observables), along.shape[1]))
        size[list(varying)] = list(varying.values())
        whole = self._filter.apply(along * size[self.problem.obs_of])
        out = []
        for c in self.problem.cells:
            if c.observable in varying:
                own = whole[c.start : c.stop, varying[c.observable] > 0.0]
                out.append((slice(c.start, c.stop), own, inverse_root(own)))
        return out

    def _without_effects(self, z: Array) -> Array:
        """Whitened columns (size, m) whose blocks' own effects are as white as all else."""
        for at, a, m in self._effects:
            z[at] -= a @ (m @ (a.T @ z[at]))
        return z

    def tolerance_of(self, c: Cell) -> tuple[Array, float, Index]:
        """What the twin or a sensor's law may be wrong by in the samples of a cell that are judged
        (n,), how long it stays the same (s), and which samples they are (n,).
        """
        noise = self.estimates.noises.get(c.observable)
        keep = np.flatnonzero(self.problem.mask[c.start : c.stop])
        own = 0.0 if noise is None else noise.tolerance
        event = self.problem.observables[c.observable].kind == "event"
        span = float(np.ptp(c.t[keep])) if keep.size > 1 else 1.0
        longest = SMALL * span if noise is None else min(SMALL * span, noise.lasts)
        tau = TINY if event else longest  # events are wrong one by one
        deviation = np.hypot(own, self.inherited[c.start : c.stop][keep])
        if (rate := float(self.rate[c.start])) and deviation.any():  # deviation over RMS rate
            tau /= float(np.hypot(1.0, tau * rate / np.sqrt(np.mean(deviation**2))))
        return deviation, tau, keep

    def whiten(self, x: Array) -> Array:
        """Whiten flat residuals (size,) or (size, m); samples the twin does not predict come back
        as 0.
        """
        z = self._filter.apply(x.reshape(x.shape[0], -1))
        return self._without_effects(z).reshape(x.shape)

    def unwhiten(self, x: Array) -> Array:
        """The transposed of :meth:`whiten`: of weights (size, m) of whitened residuals, those of
        the residuals.
        """
        return self._filter.transposed(self._without_effects(x.copy()))

    def normalise(self, x: Array) -> Array:
        """Flat residuals in units of their observable's floor and of what they inherit; samples the
        twin does not predict come back as 0.
        """
        scale = np.where(self.problem.mask, 1.0 / self._scale, 0.0)
        return x * (scale if x.ndim == 1 else scale[:, None])
