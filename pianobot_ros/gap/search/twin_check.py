"""Is the twin right where nothing is wrong? What a twin's author asks before the first diagnosis.

A diagnosis takes whatever nominal twin and robot differ by for a gap: also half a step of an
integrator, or a filter that one side has. So the mean residual of repeats, which is no scatter, is
laid beside the floor; and every effect of the library must vanish at its null and act at its
starts.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pianobot_ros.gap.floor.measure import Gauge
from pianobot_ros.gap.floor.repeats import aligned
from pianobot_ros.gap.problem.budget import Budget
from pianobot_ros.gap.problem.options import Options
from pianobot_ros.gap.problem.types import Array, Block, Effect, Twin
from pianobot_ros.gap.search.opening import open_evidence

__all__ = ["EffectCheck", "ObservableCheck", "TwinCheck", "check_twin"]


@dataclass(frozen=True)
class ObservableCheck:
    """An observable of the nominal twin: `floor` in `unit`, and what of it is `tolerance`, by which
    the twin itself is believed to err; its whole `gap`, and the largest `systematic` one of a
    `condition` (RMS of the mean residual of its repeats), in floors.
    """

    name: str
    unit: str
    floor: float
    tolerance: float
    gap: float
    systematic: float
    condition: str


@dataclass(frozen=True)
class EffectCheck:
    """An effect: how far, in floors of the observable that it changes most, it is from vanishing
    `at_null`, and the change that it makes at each of its `starts`; NaN where the twin fails.
    """

    name: str
    at_null: float
    starts: tuple[float, ...]


@dataclass(frozen=True)
class TwinCheck:
    """What was found; `str()` is a table. `ms_per_block`: time that simulating one block takes."""

    observables: tuple[ObservableCheck, ...]
    effects: tuple[EffectCheck, ...]
    ms_per_block: float
    warnings: tuple[str, ...]

    def __str__(self) -> str:
        lines = [
            f"{'observable':<28} {'floor':>10} {'tolerance':>10} {'':<6}"
            f" {'gap':>6} {'systematic':>11}  in condition"
        ]
        lines += [
            f"{o.name:<28} {o.floor:>10.3g} {o.tolerance:>10.3g} {o.unit:<6} {o.gap:>6.2f}"
            f" {o.systematic:>11.2f}  {o.condition}"
            for o in self.observables
        ]
        lines += ["", "effect                        at null  at its starts (floors)"]
        lines += [
            f"{e.name:<28} {e.at_null:>8.2g}  {', '.join(f'{x:.2g}' for x in e.starts)}"
            for e in self.effects
        ]
        lines += ["", f"{self.ms_per_block:.2g} ms to simulate a block"]
        return "\n".join([*lines, *(f"warning: {w}" for w in self.warnings)])


def check_twin(twin: Twin, blocks: Sequence[Block], options: Options | None = None) -> TwinCheck:
    """Lay the nominal twin beside recordings in which nothing should be wrong, and try each effect.

    Raises GapError where twin and blocks do not fit together.
    """
    evidence = open_evidence(twin, blocks, 0, Budget(), 1, options or Options())
    problem, gauge, nominal = evidence.problem, evidence.gauge, evidence.nominal
    begun = time.perf_counter()
    problem.twin.simulate(problem.blocks, problem.nominal(), ())
    slow = 1e3 * (time.perf_counter() - begun) / len(problem.blocks)
    observables = tuple(_observable(gauge, nominal, o) for o in problem.present)
    effects = tuple(_effect(gauge, nominal, e) for e in problem.effects.values())
    return TwinCheck(observables, effects, slow, evidence.warnings)


def _observable(gauge: Gauge, nominal: Array, o: int) -> ObservableCheck:
    problem, residual = gauge.problem, gauge.problem.y - nominal
    obs, floor = problem.observables[o], float(gauge.noise.floor[o])
    worst, where = float("nan"), ""
    for k, condition in enumerate(problem.conditions):
        cells = [
            c
            for c in problem.cells
            if c.observable == o
            and problem.condition_of_block[c.block] == k
            and not c.absent
            and problem.mask[c.start : c.stop].any()
        ]
        found = aligned(problem, cells, residual) if cells else None
        if found is None:
            continue
        size = float(np.sqrt(np.mean(found[2].mean(0) ** 2))) / floor
        if not size <= worst:
            worst, where = size, condition
    tolerance, gap = gauge.noise.estimates.noises[o].tolerance, float(gauge.gaps(nominal)[o])
    return ObservableCheck(obs.name, obs.unit, floor, tolerance, gap, worst, where)


def _effect(gauge: Gauge, nominal: Array, effect: Effect) -> EffectCheck:
    """An effect at its null, with every start's further parameters, and at its starts."""
    problem = gauge.problem
    own = {p.name: p.nominal for p in effect.parameters}
    starts = [problem.nominal() | own | dict(s) for s in effect.starts]
    vanished = [s | {effect.magnitude: effect.null} for s in starts]
    # beside what is measured the change alone is the gap of a twin that is right
    changes = [
        float("nan")
        if isinstance(result, Exception)
        else float(np.nanmax(gauge.gaps(problem.y + result - nominal)))
        for result in problem.predict_many([(v, (effect.name,)) for v in (*vanished, *starts)])
    ]
    count = len(starts)
    return EffectCheck(effect.name, float(np.max(changes[:count])), tuple(changes[count:]))
