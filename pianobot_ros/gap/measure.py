"""The gap itself: by observable, stage, signal, phase and condition, in units of the floor; and how far it was closed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pianobot_ros.gap.diagnosis import Closure, GapMap, Row
from pianobot_ros.gap.noise import NoiseModel
from pianobot_ros.gap.problem import Index, Problem
from pianobot_ros.gap.types import Array

METRIC = "held-out RMS residual over the observables, each in units of its own repeatability floor (never below it)"


class Gauge:
    """Measures flat residuals against the floor."""

    def __init__(self, problem: Problem, noise: NoiseModel) -> None:
        self.problem, self.noise = problem, noise
        shape = (problem.n_units, len(problem.observables))
        self._n = np.zeros(shape)
        use = problem.mask
        np.add.at(self._n, (problem.unit_of[use], problem.obs_of[use]), 1.0)

    def squares(self, prediction: Array) -> Array:
        """Sum of squared residuals in floor units, per unit and observable (u, o)."""
        use = self.problem.mask
        # an unstable twin may be out by anything; beyond a million floors it makes no difference
        r = np.clip(self.noise.normalise(self.problem.y - prediction)[use], -1e6, 1e6)
        out = np.zeros_like(self._n)
        np.add.at(out, (self.problem.unit_of[use], self.problem.obs_of[use]), r**2)
        return out

    def per_observable(self, squares: Array, units: Index | None = None) -> Array:
        """RMS in floor units (o,) over `units` (indices, with repetition), NaN where not measured."""
        s = squares if units is None else squares[units]
        n = self._n if units is None else self._n[units]
        total = n.sum(0)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.sqrt(np.where(total > 0, s.sum(0) / total, np.nan))

    def gaps(self, prediction: Array) -> Array:
        """RMS residual of a flat prediction by observable (o,), in floor units; NaN where not measured."""
        return self.per_observable(self.squares(prediction))

    def per_observable_error(self, squares: Array) -> Array:
        """Standard error, over units, of the squares of :meth:`per_observable` (o,); 0 with fewer than four units."""
        count = (self._n > 0).sum(0)
        total = np.maximum(self._n.sum(0), 1.0)
        departure = squares - self._n * (squares.sum(0) / total)
        spread = np.sqrt((departure**2).sum(0) * count / np.maximum(count - 1, 1)) / total
        return np.where(count >= 4, spread, 0.0)

    def pooled(self, squares: Array, units: Index | None = None, observables: list[int] | None = None) -> float:
        """One number: RMS over observables of max(1, gap)."""
        each = self.per_observable(squares, units)
        each = each if observables is None else each[observables]
        each = np.maximum(each[np.isfinite(each)], 1.0)
        return float(np.sqrt(np.mean(each**2))) if each.size else 1.0

    # -- closure --------------------------------------------------------------------------------------------------------
    def closure(self, before: Array, refit: Array, after: Array, seed: int, observable: int | None = None,
                draws: int = 400) -> Closure:  # fmt: skip
        """Closure of flat held-out predictions with a bootstrap over blocks."""
        only = None if observable is None else [observable]
        s0, s1, s2 = self.squares(before), self.squares(refit), self.squares(after)
        rng = np.random.default_rng(seed)
        blocks = self.problem.block_of_unit
        groups = [np.flatnonzero(blocks == b) for b in np.unique(blocks)]
        if len(groups) < 6:
            groups = [np.array([u], np.intp) for u in range(self.problem.n_units)]
        samples = []
        for _ in range(draws):
            units = np.concatenate([groups[i] for i in rng.integers(0, len(groups), len(groups))])
            samples.append(closed(self.pooled(s0, units, only), self.pooled(s2, units, only)))
        b, r, a = (self.pooled(s, None, only) for s in (s0, s1, s2))
        finite = [s for s in samples if np.isfinite(s)]
        low, high = np.quantile(finite, [0.025, 0.975]) if finite else (np.nan, np.nan)
        metric = (
            METRIC if observable is None else f"held-out RMS residual of {self.problem.observables[observable].name}"
        )
        return Closure(metric, "floor", 1.0, b, r, a, closed(b, a), float(low), float(high))

    # -- tables ---------------------------------------------------------------------------------------------------------
    def signals(self, prediction: Array) -> tuple[Row, ...]:
        """One row per observable, largest gap first."""
        each = self.gaps(prediction)
        excess = np.where(np.isfinite(each), np.maximum(each**2 - 1, 0), 0)
        total = float(excess.sum()) or 1.0
        rows = []
        for o in self.problem.present:
            obs, floor = self.problem.observables[o], float(self.noise.floor[o])
            rows.append(Row(obs.name, float(each[o]), 1.0, float(excess[o]) / total, obs.stage, obs.unit,
                            float(each[o]) * floor, floor))  # fmt: skip
        return tuple(sorted(rows, key=lambda r: -r.gap))

    def stages(self, prediction: Array, shares: dict[str, float]) -> tuple[Row, ...]:
        """One row per stage in causal order; gap is the pooled gap of the stage's own observables."""
        squares = self.squares(prediction)
        rows = []
        for stage in self.problem.twin.stages:
            own = [o for o in self.problem.present if self.problem.observables[o].stage == stage.name]
            gap = self.pooled(squares, None, own) if own else float("nan")
            rows.append(Row(stage.name, gap, 1.0, shares.get(stage.name, 0.0), stage.name))
        return tuple(rows)

    def phases(self, prediction: Array) -> tuple[Row, ...]:
        """One row per phase over all series."""
        values: dict[str, list[float]] = {}
        for _, phase, value in self._phase_values(prediction):
            values.setdefault(phase, []).append(value)
        gaps = {p: float(np.sqrt(np.mean(np.maximum(v, 1.0) ** 2))) for p, v in values.items()}
        total = sum(g**2 - 1 for g in gaps.values()) or 1.0
        return tuple(Row(p, g, 1.0, (g**2 - 1) / total) for p, g in gaps.items())

    def _phase_values(self, prediction: Array) -> list[tuple[int, str, float]]:
        sums: dict[tuple[int, str], list[float]] = {}
        r = self.problem.y - prediction
        for c in self.problem.cells:
            if self.problem.observables[c.observable].kind == "event":
                continue
            mask = self.problem.mask[c.start : c.stop]
            for phase, (t0, t1) in self.problem.blocks[c.block].phases.items():
                use = mask & (c.t >= t0) & (c.t <= t1)
                if use.any():
                    floor = self.noise.phase_floor.get((c.observable, phase), float(self.noise.floor[c.observable]))
                    scaled = float(np.sum((r[c.start : c.stop][use] / floor) ** 2))
                    entry = sums.setdefault((c.observable, phase), [0.0, 0.0])
                    entry[0] += scaled
                    entry[1] += float(use.sum())
        return [(o, p, float(np.sqrt(s / n))) for (o, p), (s, n) in sums.items()]

    def stage_by_phase(self, before: Array, after: Array) -> GapMap | None:
        """Gap map stage × phase."""
        phases = list(dict.fromkeys(p for b in self.problem.blocks for p in b.phases))
        if not phases:
            return None
        tables = [self._by_stage(len(phases), [(o, phases.index(p), v) for o, p, v in self._phase_values(x)])
                  for x in (before, after)]  # fmt: skip
        return self._map(tuple(phases), tables)

    def stage_by_condition(self, before: Array, after: Array) -> GapMap | None:
        """Gap map stage × condition."""
        conditions = self.problem.conditions
        if len(conditions) < 2:
            return None
        of_unit = self.problem.condition_of_block[self.problem.block_of_unit]

        def entries(prediction: Array) -> list[tuple[int, int, float]]:
            squares = self.squares(prediction)
            out = []
            for k in range(len(conditions)):
                each = self.per_observable(squares, np.flatnonzero(of_unit == k))
                out += [(o, k, float(each[o])) for o in self.problem.present if np.isfinite(each[o])]
            return out

        return self._map(conditions, [self._by_stage(len(conditions), entries(x)) for x in (before, after)])

    def _by_stage(self, columns: int, entries: list[tuple[int, int, float]]) -> Array:
        stages = [s.name for s in self.problem.twin.stages]
        cells: dict[tuple[int, int], list[float]] = {}
        for o, k, v in entries:
            cells.setdefault((stages.index(self.problem.stage_of(o)), k), []).append(v)
        out = np.full((len(stages), columns), np.nan)
        for key, values in cells.items():
            out[key] = np.sqrt(np.mean(np.square(values)))
        return out

    def _map(self, columns: tuple[str, ...], tables: list[Array]) -> GapMap:
        stages = [s.name for s in self.problem.twin.stages]
        keep = [i for i in range(len(stages)) if np.isfinite(tables[0][i]).any()]
        return GapMap(tuple(stages[i] for i in keep), columns, tables[0][keep], tables[1][keep])


def closed(before: float, after: float, floor: float = 1.0) -> float:
    """(before - after) / (before - floor); NaN where there was no gap to close."""
    if before - floor < 1e-3:
        return float("nan")
    return float(min(1.0, (before - after) / (before - floor)))


def assemble(problem: Problem, parts: list[tuple[Index, dict[str, float]]], effects: tuple[str, ...],
             failed: Callable[[str], None]) -> Array:  # fmt: skip
    """Flat held-out prediction: for every (units, values) simulate the blocks of those units with those values."""
    out = np.full(problem.size, np.nan)
    for units, values in parts:
        wanted = np.isin(problem.unit_of, units)
        prediction = problem.predict_blocks(np.unique(problem.block_of_unit[units]), values, effects)
        if prediction is None:
            failed("a held-out prediction failed; the in-sample one was used there")
            prediction = problem.predict(values, effects)
        out[wanted] = prediction[wanted]
    return out
