"""Is the twin right where nothing is wrong? What a twin's author asks before the first diagnosis.

A diagnosis takes whatever nominal twin and robot differ by for a gap: also half a step of an
integrator, or a filter that one side has. So the mean residual of repeats, which is no scatter, is
laid beside the floor; and every effect of the library must vanish at its null and act at its
starts, also where the parameters may move to meet it.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pianobot_ros.gap.fitting.fit import Fit
from pianobot_ros.gap.floor.repeats import aligned
from pianobot_ros.gap.problem.budget import Budget
from pianobot_ros.gap.problem.options import Options
from pianobot_ros.gap.problem.types import Array, Block, Effect, Twin
from pianobot_ros.gap.search.opening import open_evidence
from pianobot_ros.gap.search.parameters import fit_parameters
from pianobot_ros.gap.search.study import Study, gaps

__all__ = ["EffectCheck", "ObservableCheck", "TwinCheck", "check_twin"]


NOTHING = 1e-3
"""Floors that no diagnosis would ever see."""


@dataclass(frozen=True)
class ObservableCheck:
    """An observable: `floor` in `unit`, and what of it is `tolerance`, by which the twin itself is
    believed to err. In floors: the whole `gap` of the nominal twin, what is left of it held out
    where the parameters are `refitted`, and the largest `systematic` one of a `condition` (RMS of
    the mean residual of its repeats beyond what their scatter makes of a mean; NaN without
    repeats).
    """

    name: str
    unit: str
    floor: float
    tolerance: float
    gap: float
    refitted: float
    systematic: float
    condition: str


@dataclass(frozen=True)
class EffectCheck:
    """An effect: how far, in floors of the observable that it changes most, it is from vanishing
    `at_null`, the change that it makes at each of its `starts`, and what is `left` of that once the
    parameters have moved to meet it (linearised, as far as their priors let them); NaN where the
    twin fails.
    """

    name: str
    at_null: float
    starts: tuple[float, ...]
    left: tuple[float, ...]


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
            f" {'gap':>6} {'refitted':>9} {'systematic':>11}  in condition"
        ]
        lines += [
            f"{o.name:<28} {o.floor:>10.3g} {o.tolerance:>10.3g} {o.unit:<6} {o.gap:>6.2f}"
            f" {o.refitted:>9.2f} {o.systematic:>11.2f}  {o.condition}"
            for o in self.observables
        ]
        lines += ["", "effect                        at null  at its starts (left by parameters)"]
        lines += [
            f"{e.name:<28} {e.at_null:>8.2g}  "
            + ", ".join(f"{x:.2g} ({y:.2g})" for x, y in zip(e.starts, e.left, strict=True))
            for e in self.effects
        ]
        lines += ["", f"{self.ms_per_block:.2g} ms to simulate a block"]
        return "\n".join([*lines, *(f"warning: {w}" for w in self.warnings)])


def check_twin(twin: Twin, blocks: Sequence[Block], options: Options | None = None) -> TwinCheck:
    """Lay the nominal twin beside recordings in which nothing should be wrong, and try each effect.

    Raises GapError where twin and blocks do not fit together.
    """
    evidence = open_evidence(twin, blocks, 0, Budget(), 1, options or Options())
    problem = evidence.problem
    begun = time.perf_counter()
    problem.twin.simulate(problem.blocks, problem.nominal(), ())
    slow = 1e3 * (time.perf_counter() - begun) / len(problem.blocks)
    study = fit_parameters(evidence)
    fit = study.entry("parameters").fit
    assert fit is not None
    observables = tuple(_observable(study, o) for o in study.problem.present)
    white = study.fitter.noise.whiten(fit.jacobian)
    effects = tuple(_effect(study, fit, white, e) for e in study.problem.effects.values())
    warnings = (*study.warnings, *_generous(study), *(w for e in effects for w in _said(study, e)))
    return TwinCheck(observables, effects, slow, warnings)


def _observable(study: Study, o: int) -> ObservableCheck:
    problem, gauge, residual = study.problem, study.gauge, study.problem.y - study.nominal
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
        stack = found[2]
        square = float(np.mean(stack.mean(0) ** 2) - np.mean(stack.var(0, ddof=1)) / len(stack))
        size = float(np.sqrt(max(square, 0.0))) / floor
        if not size <= worst:
            worst, where = size, condition
    tolerance = gauge.noise.estimates.noises[o].tolerance
    gap, refitted = (float(gaps(study, study.entry(n))[o]) for n in ("none", "parameters"))
    return ObservableCheck(obs.name, obs.unit, floor, tolerance, gap, refitted, worst, where)


def _effect(study: Study, fit: Fit, white: Array, effect: Effect) -> EffectCheck:
    """An effect at its null, with every start's further parameters, and at its starts."""
    problem = study.problem
    own = {p.name: p.nominal for p in effect.parameters}
    starts = [problem.nominal() | own | dict(s) for s in effect.starts]
    vanished = [s | {effect.magnitude: effect.null} for s in starts]
    changes = [
        None if isinstance(result, Exception) else result - study.nominal
        for result in problem.predict_many([(v, (effect.name,)) for v in (*vanished, *starts)])
    ]
    sizes, count = [_size(study, x) for x in changes], len(starts)
    left = [x if x is None else _left(study, fit, white, x) for x in changes[count:]]
    remaining = tuple(_size(study, x) for x in left)
    return EffectCheck(effect.name, float(np.max(sizes[:count])), tuple(sizes[count:]), remaining)


def _size(study: Study, change: Array | None) -> float:
    """Floors of the observable that a change (size,) changes most; NaN without one."""
    if change is None:
        return float("nan")
    # beside what is measured the change alone is the gap of a twin that is right
    return float(np.nanmax(study.gauge.gaps(study.problem.y + change)))


def _left(study: Study, fit: Fit, white: Array, change: Array) -> Array:
    """What is left of a change (size,) where the parameters have moved to meet it; `white`: the
    fit's whitened Jacobian (size, p).
    """
    prior = np.eye(white.shape[1])
    step = np.linalg.solve(white.T @ white + prior, white.T @ study.fitter.noise.whiten(change))
    return np.asarray(change - fit.jacobian @ step)


def _generous(study: Study) -> list[str]:
    """Of tolerances that the twin's author has not given, and that decide."""
    noises, share = study.gauge.noise.estimates.noises, study.options.tolerance
    names = [
        study.problem.observables[o].name
        for o, noise in noises.items()
        if np.isnan(study.problem.observables[o].tolerance)
        and noise.tolerance > max(noise.repeatability, noise.hint)
    ]
    if not names:
        return []
    return [
        f"most of the floor of {', '.join(names)} is a tolerance of {100 * share:g} % of the"
        " signal's spread, since the observable has none of its own: give one"
        " (Observable.tolerance), as small as the twin deserves"
    ]


def _said(study: Study, found: EffectCheck) -> list[str]:
    """What is wrong with an effect."""
    effect, out = study.problem.effects[found.name], []
    if found.at_null > NOTHING:
        out.append(
            f"{found.name} does not vanish where {effect.magnitude} is {effect.null:g}: it must,"
            " whatever its other parameters (Effect.magnitude says which parameter is its size)"
        )
    for start, change in zip(effect.starts, found.starts, strict=True):
        if change < NOTHING:
            at = ", ".join(f"{name} = {value:g}" for name, value in start.items())
            out.append(
                f"{found.name} changes nothing at {at}: these blocks do not exercise it, or the"
                " start is too small"
            )
    return out
