"""Tables of a gap: by observable, stage, phase and condition, in units of the floor."""

from __future__ import annotations

import numpy as np

from pianobot_ros.gap.diagnosis import GapMap, Row
from pianobot_ros.gap.floor.measure import Gauge
from pianobot_ros.gap.problem.types import Array

__all__ = ["phases", "signals", "stage_by_condition", "stage_by_phase", "stages"]


def signals(gauge: Gauge, prediction: Array) -> tuple[Row, ...]:
    """One row per observable, largest gap first."""
    each = gauge.gaps(prediction)
    excess = np.where(np.isfinite(each), np.maximum(each**2 - 1, 0), 0)
    total = float(excess.sum()) or 1.0
    rows = []
    for o in gauge.problem.present:
        obs, floor = gauge.problem.observables[o], float(gauge.noise.floor[o])
        rows.append(
            Row(
                obs.name,
                float(each[o]),
                1.0,
                float(excess[o]) / total,
                obs.stage,
                obs.unit,
                float(each[o]) * floor,
                floor,
            )
        )
    return tuple(sorted(rows, key=lambda r: -r.gap))


def stages(gauge: Gauge, prediction: Array, shares: dict[str, float]) -> tuple[Row, ...]:
    """One row per stage in causal order; gap is the pooled gap of the stage's own
    observables.
    """
    squares = gauge.squares(prediction)
    rows = []
    for stage in gauge.problem.twin.stages:
        own = [o for o in gauge.problem.present if gauge.problem.observables[o].stage == stage.name]
        gap = gauge.pooled(squares, None, own) if own else float("nan")
        rows.append(Row(stage.name, gap, 1.0, shares.get(stage.name, 0.0), stage.name))
    return tuple(rows)


def phases(gauge: Gauge, prediction: Array) -> tuple[Row, ...]:
    """One row per phase over all series."""
    values: dict[str, list[float]] = {}
    for _, phase, value in _phase_values(gauge, prediction):
        values.setdefault(phase, []).append(value)
    gaps = {p: float(np.sqrt(np.mean(np.maximum(v, 1.0) ** 2))) for p, v in values.items()}
    total = sum(g**2 - 1 for g in gaps.values()) or 1.0
    return tuple(Row(p, g, 1.0, (g**2 - 1) / total) for p, g in gaps.items())


def _phase_values(gauge: Gauge, prediction: Array) -> list[tuple[int, str, float]]:
    sums: dict[tuple[int, str], list[float]] = {}
    r = gauge.problem.y - prediction
    for c in gauge.problem.cells:
        if gauge.problem.observables[c.observable].kind == "event":
            continue
        mask = gauge.problem.mask[c.start : c.stop]
        for phase, (t0, t1) in gauge.problem.blocks[c.block].phases.items():
            use = mask & (c.t >= t0) & (c.t <= t1)
            if use.any():
                known = gauge.noise.estimates
                floor = np.hypot(
                    known.phase_floor.get((c.observable, phase), known.noises[c.observable].floor),
                    gauge.noise.inherited[c.start : c.stop][use],
                )
                scaled = float(np.sum((r[c.start : c.stop][use] / floor) ** 2))
                entry = sums.setdefault((c.observable, phase), [0.0, 0.0])
                entry[0] += scaled
                entry[1] += float(use.sum())
    return [(o, p, float(np.sqrt(s / n))) for (o, p), (s, n) in sums.items()]


def stage_by_phase(gauge: Gauge, before: Array, after: Array) -> GapMap | None:
    """Gap map stage × phase."""
    names = list(dict.fromkeys(p for b in gauge.problem.blocks for p in b.phases))
    if not names:
        return None
    maps = [
        _by_stage(
            gauge, len(names), [(o, names.index(p), v) for o, p, v in _phase_values(gauge, x)]
        )
        for x in (before, after)
    ]
    return _map(gauge, tuple(names), maps)


def stage_by_condition(gauge: Gauge, before: Array, after: Array) -> GapMap | None:
    """Gap map stage × condition."""
    conditions = gauge.problem.conditions
    if len(conditions) < 2:
        return None
    of_unit = gauge.problem.condition_of_block[gauge.problem.block_of_unit]

    def entries(prediction: Array) -> list[tuple[int, int, float]]:
        squares = gauge.squares(prediction)
        out = []
        for k in range(len(conditions)):
            each = gauge.per_observable(squares, np.flatnonzero(of_unit == k))
            out += [(o, k, float(each[o])) for o in gauge.problem.present if np.isfinite(each[o])]
        return out

    return _map(
        gauge, conditions, [_by_stage(gauge, len(conditions), entries(x)) for x in (before, after)]
    )


def _by_stage(gauge: Gauge, columns: int, entries: list[tuple[int, int, float]]) -> Array:
    names = [s.name for s in gauge.problem.twin.stages]
    cells: dict[tuple[int, int], list[float]] = {}
    for o, k, v in entries:
        cells.setdefault((names.index(gauge.problem.stage_of(o)), k), []).append(v)
    out = np.full((len(names), columns), np.nan)
    for key, values in cells.items():
        out[key] = np.sqrt(np.mean(np.square(values)))
    return out


def _map(gauge: Gauge, columns: tuple[str, ...], maps: list[Array]) -> GapMap:
    names = [s.name for s in gauge.problem.twin.stages]
    keep = [i for i in range(len(names)) if np.isfinite(maps[0][i]).any()]
    return GapMap(tuple(names[i] for i in keep), columns, maps[0][keep], maps[1][keep])
