"""The measured data laid out once as flat vectors, and the twin's predictions in the same layout.

A *cell* is one observable of one block: a run of samples of the flat vectors (a single sample for an event). A *unit* is what
is scored and resampled as one piece: a block, or a piece of a block where there are few blocks.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.gap.errors import GapError, SimulationFailed
from pianobot_ros.gap.timing import Stopwatch
from pianobot_ros.gap.types import Array, Block, Effect, Observable, Parameter, Twin

Index: TypeAlias = NDArray[np.intp]
Request = tuple[Mapping[str, float], tuple[str, ...]]


@dataclass(frozen=True)
class Cell:
    """One observable of one block: samples [start, stop) of the flat vectors; `kept` indexes the block's own samples."""

    block: int
    observable: int
    start: int
    stop: int
    t: Array
    kept: Index
    absent: bool = False
    """An event that did not happen in reality: the twin is right if it predicts NaN."""


class Problem:
    """Blocks and twin, checked, flattened and counted."""

    def __init__(self, twin: Twin, blocks: Sequence[Block], *, min_units: int = 10, jobs: int = 1,
                 backend: str = "loky", max_samples: int = 100_000) -> None:  # fmt: skip
        self.twin, self.blocks = twin, tuple(blocks)
        self.observables: tuple[Observable, ...] = tuple(twin.observables)
        self.parameters: tuple[Parameter, ...] = tuple(twin.parameters)
        self.effects: dict[str, Effect] = {e.name: e for e in twin.effects}
        self.jobs, self.backend, self._max_samples = jobs, backend, max_samples
        self.calls, self.sim_seconds, self.failures = 0, 0.0, 0
        self.warnings: list[str] = []
        self._memo: dict[tuple[object, ...], Array] = {}
        self._check()
        self._lay_out()
        like = [(b.condition, b.history) for b in self.blocks]
        self.repeat_of_block = np.array([like.index(x) for x in like])
        self._cut_units(min_units)
        self._mask_unpredicted()

    # -- layout ---------------------------------------------------------------------------------------------------------
    def _check(self) -> None:
        if not self.blocks:
            raise GapError(
                "nothing to diagnose: give at least one block (two or more repeats per condition are better)"
            )
        stages = {s.name for s in self.twin.stages}
        things: list[Observable | Effect] = [*self.observables, *self.effects.values()]
        for thing in things:
            if thing.stage not in stages:
                raise GapError(f"{thing.name}: stage {thing.stage!r} is none of the twin's stages {sorted(stages)}")
        names = [o.name for o in self.observables]
        if len(set(names)) < len(names):
            raise GapError(f"the twin's observables need different names, got {names}")
        own = [p.name for p in self.parameters] + [p.name for e in self.effects.values() for p in e.parameters]
        if len(set(own)) < len(own):
            double = sorted({n for n in own if own.count(n) > 1})
            raise GapError(f"parameter names must be unique over nuisances and effects, twice: {double}")

    def _lay_out(self) -> None:
        cells: list[Cell] = []
        ys: list[Array] = []
        at = 0
        self._group = self._group_size()
        self._miss = {o: self._miss_size(obs) for o, obs in enumerate(self.observables) if obs.kind == "event"}
        for b, block in enumerate(self.blocks):
            for o, obs in enumerate(self.observables):
                if obs.kind == "event":
                    value = block.events.get(obs.signal)
                    if value is None:
                        continue
                    absent = not math.isfinite(value)
                    t, y, kept = np.zeros(1), np.array([0.0 if absent else value], float), np.zeros(1, np.intp)
                else:
                    absent = False
                    signal = block.outputs.get(obs.signal)
                    if signal is None:
                        continue
                    kept = np.flatnonzero(np.isfinite(signal.y) & np.isfinite(signal.t))
                    if kept.size < 3:
                        continue
                    t, y = signal.t[kept], signal.y[kept]
                    if np.any(np.diff(t) < 0):
                        order = np.argsort(t, kind="stable")
                        kept, t, y = kept[order], t[order], y[order]
                group = self._group if obs.kind == "series" else 1
                if group > 1:
                    t, y = _means(t, group), _means(y, group)
                cells.append(Cell(b, o, at, at + y.size, t, kept, absent))
                ys.append(y)
                at += y.size
        if not cells:
            wanted = sorted({o.signal for o in self.observables})
            raise GapError(
                f"no block holds any signal or event that the twin predicts; it predicts {', '.join(wanted)}"
            )
        self.cells, self.y = tuple(cells), np.concatenate(ys)
        self.size = at
        self.obs_of = np.concatenate([np.full(c.stop - c.start, c.observable) for c in cells])
        self.block_of = np.concatenate([np.full(c.stop - c.start, c.block) for c in cells])
        spans = [
            float(np.ptp(self.y[self.obs_of == o])) if np.any(self.obs_of == o) else 0.0
            for o in range(len(self.observables))
        ]
        self._span = np.maximum(np.array(spans), 1e-12)[self.obs_of]
        present = {c.observable for c in cells}
        lost = [o.name for i, o in enumerate(self.observables) if i not in present]
        if lost:
            self.warnings.append(f"not measured, so not judged: {', '.join(lost)}")
        self.present = tuple(sorted(present))
        conditions = list(dict.fromkeys(b.condition for b in self.blocks))
        self.conditions = tuple(conditions)
        self.condition_of_block = np.array([conditions.index(b.condition) for b in self.blocks])
        flat = [self.observables[o].name for o in self.present if np.ptp(self.y[self.obs_of == o]) == 0]
        if flat:
            self.warnings.append(f"constant throughout, so they say little: {', '.join(flat)}")

    def _runs(self) -> list[tuple[int, int, int, int]]:
        """Stretches of samples that belong to one unit and one observable."""
        out = []
        for c in self.cells:
            cuts = np.flatnonzero(np.diff(self.unit_of[c.start : c.stop])) + 1 + c.start
            edges = [c.start, *cuts.tolist(), c.stop]
            out += [(a, b, int(self.unit_of[a]), c.observable) for a, b in pairwise(edges)]
        return out

    def _group_size(self) -> int:
        """Neighbouring samples are averaged in groups of this size, so that long recordings stay affordable."""
        wanted = {o.signal for o in self.observables if o.kind == "series"}
        count = {o.signal: 0 for o in self.observables}
        for o in self.observables:
            count[o.signal] += 1
        total = sum(count[n] * s.t.size for b in self.blocks for n, s in b.outputs.items() if n in wanted)
        shortest = min((s.t.size for b in self.blocks for n, s in b.outputs.items() if n in wanted), default=1)
        return max(1, min(math.ceil(total / self._max_samples), shortest // 24))

    def _miss_size(self, obs: Observable) -> float:
        """Residual that stands for an event that one side has and the other has not."""
        seen = [b.events[obs.signal] for b in self.blocks if math.isfinite(b.events.get(obs.signal, math.nan))]
        return max(5.0 * obs.floor_hint, 0.5 * float(np.std(seen)) if seen else 0.0, 1e-9) or 1.0

    def _cut_units(self, min_units: int) -> None:
        pieces = max(1, math.ceil(min_units / len(self.blocks)))
        self.unit_of = np.empty(self.size, int)
        starts: dict[int, float] = {}
        ends: dict[int, float] = {}
        for c in self.cells:
            if self.observables[c.observable].kind == "series":
                starts[c.block] = min(starts.get(c.block, math.inf), float(c.t[0]))
                ends[c.block] = max(ends.get(c.block, -math.inf), float(c.t[-1]))
        for c in self.cells:
            part = np.zeros(c.t.size, int)
            if pieces > 1 and self.observables[c.observable].kind == "series" and ends[c.block] > starts[c.block]:
                part = np.floor(pieces * (c.t - starts[c.block]) / (ends[c.block] - starts[c.block])).astype(int)
            self.unit_of[c.start : c.stop] = c.block * pieces + np.minimum(part, pieces - 1)
        used, self.unit_of = np.unique(self.unit_of, return_inverse=True)
        self.n_units = used.size
        self.block_of_unit = used // pieces
        self.runs = self._runs()
        if pieces > 1:
            self.warnings.append(
                f"only {len(self.blocks)} block(s): each was cut into {pieces} pieces of time for scoring, which is weaker "
                "than separate blocks"
            )

    # -- predictions ----------------------------------------------------------------------------------------------------
    def nominal(self) -> dict[str, float]:
        """Nominal nuisance values."""
        return {p.name: p.nominal for p in self.parameters}

    def _mask_unpredicted(self) -> None:
        """Samples that the nominal twin leaves NaN are no observations; an effect may not add to them (see `_fill`)."""
        self.mask = np.ones(self.size, bool)
        self._nominal_y: Array = np.zeros(0)
        nominal = self.predict(self.nominal(), ())
        self.mask = np.isfinite(nominal)
        self._nominal_y = np.where(self.mask, nominal, self.y)
        self._memo.clear()
        if not self.mask.any():
            raise GapError(
                "the twin predicts nothing but NaN at its nominal parameters; try twin.simulate on one block"
            )
        missing = [self.observables[o].name for o in self.present if not self.mask[self.obs_of == o].any()]
        if missing:
            self.warnings.append(f"the twin makes no prediction for {', '.join(missing)}")
            self.present = tuple(o for o in self.present if self.mask[self.obs_of == o].any())

    def _flatten(self, predictions: Sequence[Mapping[str, object]]) -> Array:
        if len(predictions) != len(self.blocks):
            raise GapError(f"simulate returned {len(predictions)} predictions for {len(self.blocks)} blocks")
        out = np.full(self.size, np.nan)
        for c in self.cells:
            obs = self.observables[c.observable]
            value = predictions[c.block].get(obs.name)
            if value is None:
                continue
            series = np.atleast_1d(np.asarray(value, float))
            if obs.kind == "event":
                happens = bool(np.isfinite(series[0]))
                wrong = self.y[c.start] + self._miss[c.observable]
                out[c.start] = (wrong if happens else 0.0) if c.absent else (series[0] if happens else wrong)
                continue
            if obs.kind == "series":
                expected = self.blocks[c.block].outputs[obs.signal].t.size
                if series.shape != (expected,):
                    raise GapError(f"simulate returned shape {series.shape} for {obs.name}, expected ({expected},): one "
                                   "value per measured sample")  # fmt: skip
            picked = series[c.kept]
            out[c.start : c.stop] = picked if self._group == 1 else _means(picked, self._group)
        return out

    def _fill(self, flat: Array) -> Array:
        if self._nominal_y.size == 0:
            return flat
        bad = self.mask & ~(np.abs(flat - self.y) < 1e6 * (np.abs(self._nominal_y - self.y) + self._span))
        if bad.sum() > 0.3 * self.mask.sum():
            raise SimulationFailed("the twin returned NaN for most samples")
        return np.where(bad | ~self.mask, self._nominal_y, flat)

    @staticmethod
    def _key(values: Mapping[str, float], effects: Sequence[str]) -> tuple[object, ...]:
        return (tuple(sorted(effects)), *sorted(values.items()))

    def recentre(self, values: Mapping[str, float]) -> bool:
        """Tell a twin that approximates where to be most exact; whether it does, so that predictions must be made anew."""
        move = getattr(self.twin, "recentre", None)
        if move is None:
            return False
        move(values)
        self._memo.clear()
        return True

    def predict(self, values: Mapping[str, float], effects: Sequence[str]) -> Array:
        """Flat prediction (size,); raises SimulationFailed if the twin cannot."""
        (result,) = self.predict_many([(values, tuple(effects))])
        if isinstance(result, Exception):
            raise result
        return result

    def predict_many(self, requests: Sequence[Request]) -> list[Array | SimulationFailed]:
        """Several predictions, batched or in parallel where the twin or `jobs` allows; failures come back as values."""
        todo = list({self._key(*r): r for r in requests if self._key(*r) not in self._memo}.items())
        start = Stopwatch()
        fresh: dict[tuple[object, ...], Array | SimulationFailed] = {}
        for (key, _), raw in zip(todo, self._run([r for _, r in todo]), strict=True):
            if isinstance(raw, SimulationFailed):
                fresh[key] = raw
                self.failures += 1
                continue
            try:
                fresh[key] = self._memo[key] = self._fill(self._flatten(raw))
            except SimulationFailed as failed:
                fresh[key] = failed
                self.failures += 1
        self.calls += len(todo)
        self.sim_seconds += start.used()
        out = [self._memo[self._key(*r)] if self._key(*r) in self._memo else fresh[self._key(*r)] for r in requests]
        while len(self._memo) > 64:
            self._memo.pop(next(iter(self._memo)))
        return out

    def predict_blocks(self, chosen: Array, values: Mapping[str, float], effects: tuple[str, ...]) -> Array | None:
        """Flat prediction of the chosen blocks (indices) only, NaN elsewhere; None if the twin fails."""
        start = Stopwatch()
        picked = [int(b) for b in chosen]
        raw = _simulate(self.twin, [self.blocks[b] for b in picked], values, effects)
        self.calls += 1
        self.sim_seconds += start.used()
        if isinstance(raw, SimulationFailed):
            self.failures += 1
            return None
        full: list[Mapping[str, object]] = [{} for _ in self.blocks]
        for b, prediction in zip(picked, raw, strict=True):
            full[b] = prediction
        flat = self._flatten(full)
        return np.where(np.isfinite(flat) | ~np.isin(self.block_of, picked), flat, self._nominal_y)

    def _run(self, requests: Sequence[Request]) -> list[Sequence[Mapping[str, object]] | SimulationFailed]:
        many = getattr(self.twin, "simulate_many", None)
        if many is not None and len(requests) > 1:
            try:
                return list(many(self.blocks, [(dict(v), e) for v, e in requests]))
            except GapError:
                raise
            except Exception:  # a batch may fail because of one member: find out which below
                self.failures += 1
        if self.jobs > 1 and len(requests) > 1:
            from joblib import Parallel, delayed, parallel_config

            work = (delayed(_simulate)(self.twin, self.blocks, v, e) for v, e in requests)
            with parallel_config(backend=self.backend, n_jobs=self.jobs):  # unlike Parallel(backend=…), this knows Dask
                return list(Parallel()(work))
        return [_simulate(self.twin, self.blocks, v, e) for v, e in requests]

    # -- views ----------------------------------------------------------------------------------------------------------
    def stage_of(self, observable: int) -> str:
        """Stage name of an observable's index."""
        return self.observables[observable].stage


def _means(x: Array, group: int) -> Array:
    """Means of `group` neighbours; the last group may be smaller."""
    whole = x.size // group * group
    means = x[:whole].reshape(-1, group).mean(1)
    return np.asarray(means if whole == x.size else np.append(means, x[whole:].mean()))


def _simulate(twin: Twin, blocks: Sequence[Block], values: Mapping[str, float],
              effects: Sequence[str]) -> Sequence[Mapping[str, object]] | SimulationFailed:  # fmt: skip
    """One call of the twin; whatever it throws concerns only this candidate."""
    try:
        return twin.simulate(blocks, dict(values), tuple(effects))
    except GapError:
        raise
    except Exception as error:  # a user's simulator may fail in any way
        return SimulationFailed(f"{type(error).__name__}: {error}")
