"""The gap itself: by observable, stage, signal, phase and condition, in units of the floor; and how
far it was closed.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.gap.diagnosis import Closure
from pianobot_ros.gap.floor.noise import NoiseModel
from pianobot_ros.gap.floor.scatter import by_chance, strays
from pianobot_ros.gap.problem.constants import (
    DRAWS,
    ENOUGH,
    NEGLIGIBLE,
    RUN_AWAY,
    UPPER,
)
from pianobot_ros.gap.problem.problem import Index, Problem
from pianobot_ros.gap.problem.types import Array

METRIC = (
    "held-out RMS residual over the observables, each in units of its own repeatability floor"
    " (never below it)"
)


class Gauge:
    """Measures flat residuals against the floor."""

    def __init__(self, problem: Problem, noise: NoiseModel) -> None:
        self.problem, self.noise = problem, noise
        self._n = problem.per_unit(np.ones(problem.size))

    @property
    def together(self) -> Index:
        """The groups (u,) in which a bootstrap draws the units."""
        blocks = self.problem.block_of_unit
        return drawn_together(self.problem.condition_of_block[blocks], blocks)

    def squares(self, prediction: Array) -> Array:
        """Sum of squared residuals in floor units, per unit and observable (u, o)."""
        # an unstable twin may be out by anything
        r = np.clip(self.noise.normalise(self.problem.y - prediction), -RUN_AWAY, RUN_AWAY)
        return self.problem.per_unit(r**2)

    def per_observable(self, squares: Array, units: Index | slice = slice(None)) -> Array:
        """RMS in floor units (o,) over `units` (indices; default: all), NaN where not measured."""
        total = self._n[units].sum(0)
        square = squares[units].sum(0) / np.where(total > 0, total, np.nan)
        return np.asarray(np.sqrt(square))

    def gaps(self, prediction: Array) -> Array:
        """RMS residual of a flat prediction by observable (o,), in floor units; NaN where not
        measured.
        """
        return self.per_observable(self.squares(prediction))

    def strays(self, squares: Array) -> NDArray[np.bool_]:
        """Blocks (b, o) in which an observable is far from what is predicted, where most of its
        blocks are close to that.
        """
        count, total = self._samples, self.by_block(squares)
        out = np.zeros(count.shape, bool)
        for o, there in enumerate((count > 0).T):
            if there.any():
                out[there, o] = strays(np.sqrt(total[there, o] / count[there, o]), 1.0)
        return out

    def more_strays_than_chance(self, squares: Array) -> NDArray[np.bool_]:
        """Of which observables (o,) so many blocks are :meth:`strays` that they are no accident."""
        return np.asarray(self.strays(squares).sum(0) > self._accidents)

    @cached_property
    def _samples(self) -> Array:
        """How many are judged in each block of each observable (b, o)."""
        return self.by_block(self._n)

    @cached_property
    def _accidents(self) -> Array:
        """Of how many blocks of each observable (o,) chance alone makes strays."""
        return np.array([by_chance(int(n)) for n in (self._samples > 0).sum(0)])

    def by_block(self, of_units: Array) -> Array:
        """Sums by block (b, o) of what is by unit (u, o)."""
        out = np.zeros((len(self.problem.blocks), of_units.shape[1]))
        np.add.at(out, self.problem.block_of_unit, of_units)
        return out

    def per_observable_error(self, squares: Array) -> Array:
        """Standard error of the squares of :meth:`per_observable` (o,), by how far units are from
        those of their condition's repeats, and where nothing repeats from each other: what one
        condition has that others have not is no chance. 0 with fewer than :data:`ENOUGH` units.
        """
        there = self._n > 0
        total = np.maximum(self._n.sum(0), 1.0)
        variance = np.zeros(total.size)
        for own in self._alike:
            n, count = self._n[own], there[own].sum(0)
            mean = squares[own].sum(0) / np.maximum(n.sum(0), 1.0)
            variance += ((squares[own] - n * mean) ** 2).sum(0) * count / np.maximum(count - 1, 1)
        return np.where(there.sum(0) >= ENOUGH, np.sqrt(variance) / total, 0.0)

    @cached_property
    def _alike(self) -> list[Index]:
        """Units by the condition that their blocks repeat; together all that nothing repeats."""
        problem = self.problem
        repeated = np.bincount(problem.condition_of_block) > 1
        condition = problem.condition_of_block[problem.block_of_unit]
        group = np.where(repeated[condition], condition, -1)
        return [np.flatnonzero(group == k) for k in np.unique(group)]

    def pooled(self, squares: Array, observables: list[int] | None = None) -> float:
        """One number: RMS over observables of max(1, gap)."""
        return float(self.pooled_each(squares, np.ones((1, len(squares))), observables)[0])

    def pooled_each(
        self, squares: Array, times: Array, observables: list[int] | None = None
    ) -> Array:
        """The same for each draw (d,), in which every unit is there so many `times` (d, u)."""
        total = times @ self._n
        each = np.sqrt(times @ squares / np.where(total > 0, total, np.nan))
        each = np.maximum(each if observables is None else each[:, observables], 1.0)
        there = np.isfinite(each)
        mean = np.where(there, each**2, 0.0).sum(1) / np.maximum(there.sum(1), 1)
        return np.where(there.any(1), np.sqrt(mean), 1.0)

    def closure(
        self, before: Array, refit: Array, after: Array, seed: int, observable: int | None = None
    ) -> Closure:
        """Closure of flat held-out predictions with a bootstrap."""
        only, metric = None, METRIC
        if observable is not None:
            name = self.problem.observables[observable].name
            only, metric = [observable], f"held-out RMS residual of {name}"
        times = as_drawn(self.together, np.random.default_rng(seed))
        b, r, a = (self.pooled_each(self.squares(x), times, only) for x in (before, refit, after))
        whole, effect = (
            np.array([closed(*pair) for pair in zip(x.tolist(), a.tolist(), strict=True)])
            for x in (b, r)
        )
        gaps = float(b[0]), float(r[0]), float(a[0])
        shares = float(whole[0]), *interval(whole[1:]), closed(*gaps[:2]), float(effect[0])
        return Closure(metric, "floor", 1.0, *gaps, *shares, *interval(effect[1:]))


def drawn_together(conditions: Sequence[object] | Array, blocks: Sequence[object] | Array) -> Index:
    """The groups (n,) in which a bootstrap draws what has these `conditions` and `blocks` (n,
    each): by condition; where there are few by block; where these are few each alone.
    """
    for labels in (conditions, blocks):
        group = np.unique(np.asarray(labels), return_inverse=True)[1]
        if group.max() + 1 >= ENOUGH:
            return np.asarray(group)
    return np.arange(len(blocks))


def as_drawn(group: Index, random: np.random.Generator) -> Array:
    """How many times each thing is there (1 + d, n): once, then in each draw of a bootstrap over
    the groups of the things (n,).
    """
    count = int(group.max()) + 1
    picked = random.integers(0, count, (DRAWS, count))
    times = np.ones((1 + DRAWS, count))
    times[1:] = [np.bincount(p, minlength=count) for p in picked]
    return times[:, group]


def closed(before: float, after: float) -> float:
    """(before - after) / (before - 1), of gaps in floors; NaN where there was no gap to close."""
    if before - 1.0 < NEGLIGIBLE:
        return float("nan")
    return float(min(1.0, (before - after) / (before - 1.0)))


def interval(samples: Array) -> tuple[float, float]:
    """95 % interval of the samples (n,) that are numbers."""
    finite = samples[np.isfinite(samples)]
    if not finite.size:
        return float("nan"), float("nan")
    low, high = np.quantile(finite, [1.0 - UPPER, UPPER])
    return float(low), float(high)
