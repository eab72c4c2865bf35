"""The repeatability floor: what repeated blocks differ by although nothing was changed, and the
whitening of residuals by it.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from pianobot_ros.gap.floor.estimate import Estimates, estimates
from pianobot_ros.gap.floor.whiten import Whitener
from pianobot_ros.gap.problem.constants import SMALL, TINY
from pianobot_ros.gap.problem.layout import Index
from pianobot_ros.gap.problem.options import Options
from pianobot_ros.gap.problem.problem import Cell, Problem
from pianobot_ros.gap.problem.types import Array


class NoiseModel:
    """The `floor` of every observable (o,), in its own unit, and whitening of flat residuals.

    `inherited` (size,): deviation that each sample has from what was spliced in before it (see
    :mod:`~pianobot_ros.gap.floor.splice`; default: none).
    """

    def __init__(
        self,
        problem: Problem,
        options: Options,
        estimates: Estimates,
        inherited: Array | None = None,
    ) -> None:
        self.problem, self.options, self.estimates = problem, options, estimates
        self.inherited = np.zeros(problem.size) if inherited is None else inherited
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
            own = noise.correlated, noise.tau
            filters.append(Whitener.of(t, white, own, (tolerance, tau_tol), at))
        return Whitener.joined(filters)

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
        return np.hypot(own, self.inherited[c.start : c.stop][keep]), tau, keep

    def whiten(self, x: Array) -> Array:
        """Whiten flat residuals (size,) or (size, m); samples the twin does not predict come back
        as 0.
        """
        return self._filter.apply(x.reshape(x.shape[0], -1)).reshape(x.shape)

    def unwhiten(self, x: Array) -> Array:
        """The transposed of :meth:`whiten`: of weights (size, m) of whitened residuals, those of
        the residuals.
        """
        return self._filter.transposed(x)

    def normalise(self, x: Array) -> Array:
        """Flat residuals in units of their observable's floor and of what they inherit; samples the
        twin does not predict come back as 0.
        """
        scale = np.where(self.problem.mask, 1.0 / self._scale, 0.0)
        return x * (scale if x.ndim == 1 else scale[:, None])
