"""Tables of a gap, by observable, stage, phase and condition, in units of the floor; and the traces
that a report draws, of each observable in every block.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeAlias

import numpy as np

from pianobot_ros.gap.diagnosis import GapMap, Row, Trace
from pianobot_ros.gap.floor.measure import Gauge
from pianobot_ros.gap.problem.constants import SAMPLES, SMALL
from pianobot_ros.gap.problem.types import Array

_Value: TypeAlias = tuple[int, str, float]
"""Observable, column of a map, gap in floors."""


def signals(gauge: Gauge, prediction: Array) -> tuple[Row, ...]:
    """One row per observable, largest gap first."""
    each = gauge.gaps(prediction)
    excess = np.where(np.isfinite(each), np.maximum(each**2 - 1, 0), 0)
    total = float(excess.sum()) or 1.0
    rows = []
    for o in gauge.problem.present:
        obs, floor = gauge.problem.observables[o], float(gauge.noise.floor[o])
        gap, share = float(each[o]), float(excess[o]) / total
        rows.append(Row(obs.name, gap, 1.0, share, obs.stage, obs.unit, gap * floor, floor))
    return tuple(sorted(rows, key=lambda r: -r.gap))


def stages(gauge: Gauge, prediction: Array, shares: dict[str, float]) -> tuple[Row, ...]:
    """One row per stage in causal order; gap is the pooled gap of the stage's own
    observables.
    """
    squares = gauge.squares(prediction)
    rows = []
    for stage in gauge.problem.twin.stages:
        own = [o for o in gauge.problem.present if gauge.problem.observables[o].stage == stage.name]
        gap = gauge.pooled(squares, own) if own else float("nan")
        share, said = shares.get(stage.name, 0.0), stage.description
        rows.append(Row(stage.name, gap, 1.0, share, stage.name, description=said))
    return tuple(rows)


def phases(gauge: Gauge, prediction: Array) -> tuple[Row, ...]:
    """One row per phase over all series."""
    values: dict[str, list[float]] = {}
    for _, phase, value in _phase_values(gauge, prediction):
        values.setdefault(phase, []).append(value)
    gaps = {p: float(np.sqrt(np.mean(np.maximum(v, 1.0) ** 2))) for p, v in values.items()}
    total = sum(g**2 - 1 for g in gaps.values()) or 1.0
    return tuple(Row(p, g, 1.0, (g**2 - 1) / total) for p, g in gaps.items())


def stage_by_phase(gauge: Gauge, before: Array, after: Array) -> GapMap | None:
    """Gap map stage × phase."""
    names = tuple(dict.fromkeys(p for b in gauge.problem.blocks for p in b.phases))
    return _map(gauge, names, [_phase_values(gauge, x) for x in (before, after)]) if names else None


def stage_by_condition(gauge: Gauge, before: Array, after: Array) -> GapMap | None:
    """Gap map stage × condition."""
    names = gauge.problem.conditions
    if len(names) < 2:
        return None
    return _map(gauge, names, [_condition_values(gauge, x) for x in (before, after)])


def _phase_values(gauge: Gauge, prediction: Array) -> list[_Value]:
    sums: dict[tuple[int, str], Array] = {}
    problem, known, r = gauge.problem, gauge.noise.estimates, gauge.problem.y - prediction
    for c in problem.cells:
        if problem.observables[c.observable].kind == "event":
            continue
        mask = problem.mask[c.start : c.stop]
        for phase, (t0, t1) in problem.blocks[c.block].phases.items():
            use = mask & (c.t >= t0) & (c.t <= t1)
            if use.any():
                key = c.observable, phase
                own = known.phase_floor.get(key, known.noises[c.observable].floor)
                floor = np.hypot(own, gauge.noise.inherited[c.start : c.stop][use])
                own_sum = np.sum((r[c.start : c.stop][use] / floor) ** 2), use.sum()
                sums[key] = sums.get(key, np.zeros(2)) + np.array(own_sum)
    return [(o, p, float(np.sqrt(s / n))) for (o, p), (s, n) in sums.items()]


def _condition_values(gauge: Gauge, prediction: Array) -> list[_Value]:
    problem, squares = gauge.problem, gauge.squares(prediction)
    of_unit = problem.condition_of_block[problem.block_of_unit]
    out = []
    for k, name in enumerate(problem.conditions):
        each = gauge.per_observable(squares, np.flatnonzero(of_unit == k))
        out += [(o, name, float(each[o])) for o in problem.present if np.isfinite(each[o])]
    return out


def _map(gauge: Gauge, columns: tuple[str, ...], values: list[list[_Value]]) -> GapMap:
    """The map of values before and after, of the stages that have any before."""
    names, observables = [s.name for s in gauge.problem.twin.stages], gauge.problem.observables
    maps = np.full((2, len(names), len(columns)), np.nan)
    for out, found in zip(maps, values, strict=True):
        cells: dict[tuple[int, int], list[float]] = {}
        for o, column, v in found:
            key = names.index(observables[o].stage), columns.index(column)
            cells.setdefault(key, []).append(v)
        for key, each in cells.items():
            out[key] = np.sqrt(np.mean(np.square(each)))
    keep = np.flatnonzero(np.isfinite(maps[0]).any(1))
    return GapMap(tuple(names[i] for i in keep), columns, maps[0][keep], maps[1][keep])


def traces(gauge: Gauge, predictions: tuple[Array, Array, Array]) -> tuple[Trace, ...]:
    """Traces of all series observables, worst observable first, and of each the typical block
    first. ``predictions`` of the twin: before, refitted, after.
    """
    problem, before = gauge.problem, predictions[0]
    residual = problem.y - before
    of_observable = {
        problem.observables[o].name: problem.cells_of(o)
        for o in problem.present
        if problem.observables[o].kind != "event"
    }
    count = sum(map(len, of_observable.values()))
    share = max(2, gauge.noise.options.max_samples // max(count, 1))
    masked = np.where(problem.mask, 0.0, np.nan)
    found = []
    for name in [r.name for r in signals(gauge, before) if r.name in of_observable]:
        cells = of_observable[name]
        rms = [float(np.sqrt(np.mean(problem.judged(c, residual) ** 2))) for c in cells]
        typical = cells[int(np.argsort(rms)[len(rms) // 2])]
        for c in (typical, *(c for c in cells if c is not typical)):
            limit = SAMPLES if c is typical else min(share, SAMPLES)
            cut = slice(c.start, c.stop, max(1, -(-(c.stop - c.start) // limit)))
            obs, block = problem.observables[c.observable], problem.blocks[c.block]
            first, refit, after = ((prediction + masked)[cut] for prediction in predictions)
            found.append(
                Trace(
                    block.name,
                    block.condition,
                    obs.name,
                    obs.stage,
                    obs.unit,
                    float(gauge.noise.floor[c.observable]),
                    c.t[:: cut.step] - c.t[0],
                    problem.y[cut],
                    first,
                    refit,
                    after,
                    c is typical,
                )
            )
    return tuple(found)


def in_few_blocks(
    gauge: Gauge, prediction: Array, observables: Iterable[int]
) -> dict[str, list[int]]:
    """Of each of the `observables` whose gap is nearly all in a tenth of the blocks, or in one:
    these blocks, worst first.
    """
    problem, squares = gauge.problem, gauge.squares(prediction)
    above = gauge.by_block(squares - problem.per_unit(np.ones(problem.size)))
    out = {}
    for o in observables:
        each = above[:, o]
        worst, most = np.argsort(-each), (1.0 - SMALL) * float(np.maximum(each, 0.0).sum())
        count = int(np.argmax(np.cumsum(each[worst]) >= most)) + 1
        measured = len(problem.cells_of(o))
        if count <= max(SMALL * measured, 1.0) and measured > 2:
            out[problem.observables[o].name] = worst[:count].tolist()
    return out
