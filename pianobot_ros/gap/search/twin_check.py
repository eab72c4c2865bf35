"""Is the twin right where nothing is wrong? What a twin's author asks before the first diagnosis.

A diagnosis takes whatever nominal twin and robot differ by for a gap: also half a step of an
integrator, or a filter that one side has. So the mean residual of repeats, which is no scatter, is
laid beside the floor; and every effect of the library must vanish at its null and act at its
starts, also where the parameters may move to meet it.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pianobot_ros.gap.fitting.fit import Fit
from pianobot_ros.gap.floor.repeats import side_by_side
from pianobot_ros.gap.floor.splice import noise_followed
from pianobot_ros.gap.problem.budget import Budget
from pianobot_ros.gap.problem.constants import NEGLIGIBLE, SMALL, TINY
from pianobot_ros.gap.problem.options import Options
from pianobot_ros.gap.problem.types import Array, Block, Effect, Twin
from pianobot_ros.gap.search.opening import not_vanishing, open_evidence
from pianobot_ros.gap.search.parameters import fit_parameters
from pianobot_ros.gap.search.study import Study, gaps

__all__ = ["EffectCheck", "ObservableCheck", "TwinCheck", "check_twin"]


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
    twin fails. `shows_in`: the observable in which most is left. `like`: the other effect whose
    change, at any of its starts, is left in the same shape, and how `alike` (the cosine of the
    angle between the two: 1 cannot be told apart).
    """

    name: str
    at_null: float
    starts: tuple[float, ...]
    left: tuple[float, ...]
    shows_in: str
    like: str
    alike: float


@dataclass(frozen=True)
class TwinCheck:
    """What was found; `str()` is a table. `ms_per_block`: wall time to simulate one block."""

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
        if self.effects:
            lines += ["", f"{'effect':<28} {'at null':>8}  at its starts (left by parameters)"]
        for e in self.effects:
            sizes = ", ".join(f"{x:.2g} ({y:.2g})" for x, y in zip(e.starts, e.left, strict=True))
            most = f"; most in {e.shows_in}" if e.shows_in else ""
            like = f"; {e.alike:.2f} like {e.like}" if e.like else ""
            lines.append(f"{e.name:<28} {e.at_null:>8.2g}  {sizes}{most}{like}")
        lines += ["", f"{self.ms_per_block:.2g} ms (wall time) to simulate a block"]
        return "\n".join([*lines, *(f"warning: {w}" for w in self.warnings)])


def check_twin(
    twin: Twin,
    blocks: Sequence[Block],
    options: Options | None = None,
    effects: Sequence[str] | None = None,
) -> TwinCheck:
    """Lay the nominal twin beside recordings in which nothing should be wrong, and try the
    `effects` of these names (default: all).

    Raises GapError where twin and blocks do not fit together, or an effect is not in the library.
    """
    options = options or Options()
    if effects is not None:
        options = replace(options, only=tuple(effects))  # an unknown name is refused with these
    evidence = open_evidence(twin, blocks, 0, Budget(), 1, options)
    problem = evidence.problem
    begun = time.perf_counter()
    problem.twin.simulate(problem.blocks, problem.nominal(), ())
    slow = 1e3 * (time.perf_counter() - begun) / len(problem.blocks)
    study = fit_parameters(evidence)
    fit = study.entry("parameters").fit
    observables = tuple(_observable(study, o) for o in study.problem.present)
    names = study.problem.effects if effects is None else effects
    found = _effects(study, fit, [study.problem.effects[n] for n in names])
    said = (
        w for e in found for w in (*_said(study, e), *_silent(study, e.name), *_noisy(study, e))
    )
    warnings = (*study.warnings, *_generous(study), *_widened(study, observables), *said)
    return TwinCheck(observables, found, slow, warnings)


def _observable(study: Study, o: int) -> ObservableCheck:
    problem, gauge, residual = study.problem, study.gauge, study.problem.y - study.nominal
    obs, floor = problem.observables[o], float(gauge.noise.floor[o])
    worst, where = float("nan"), ""
    cells = [c for c in problem.cells_of(o) if not c.absent]
    for k, condition in enumerate(problem.conditions):
        own = [c for c in cells if problem.condition_of_block[c.block] == k]
        if len(own) < 2:
            continue
        stack = residual[side_by_side(problem, own).at]
        square = float(np.mean(stack.mean(0) ** 2) - np.mean(stack.var(0, ddof=1)) / len(stack))
        size = float(np.sqrt(max(square, 0.0))) / floor
        if not size <= worst:
            worst, where = size, condition
    tolerance = gauge.noise.estimates.noises[o].tolerance
    gap, refitted = (float(gaps(study, study.entry(n))[o]) for n in ("none", "parameters"))
    return ObservableCheck(obs.name, obs.unit, floor, tolerance, gap, refitted, worst, where)


@dataclass(frozen=True)
class _Probe:
    """An effect's sizes `at_null` and at its `starts`, and the changes (size,) that the parameters
    leave there, where the twin does not fail.
    """

    effect: Effect
    at_null: float
    starts: tuple[float, ...]
    left: tuple[Array | None, ...]


def _effects(study: Study, fit: Fit, effects: Sequence[Effect]) -> tuple[EffectCheck, ...]:
    white = study.fitter.noise.whiten(fit.jacobian)
    probes = [_probe(study, fit, white, e) for e in effects]
    shapes = [(k, _shape(study, x)) for k, p in enumerate(probes) for x in p.left if x is not None]
    owner = np.array([k for k, _ in shapes], int)
    rows = np.array([x for _, x in shapes]).reshape(len(shapes), study.problem.size)
    cosines = np.abs(rows @ rows.T)
    out = []
    for k, p in enumerate(probes):
        floors = np.array([_gaps_of(study, x) for x in p.left])  # (starts, o)
        most = np.nan_to_num(floors).max(0)
        widest = int(np.argmax(most))
        others = np.where(owner != k, cosines[owner == k].max(0, initial=0.0), 0.0)
        alike = float(others.max(initial=0.0))
        out.append(
            EffectCheck(
                p.effect.name,
                p.at_null,
                p.starts,
                tuple(floors.max(1).tolist()),
                study.problem.observables[widest].name if most[widest] > 0.0 else "",
                effects[owner[int(np.argmax(others))]].name if alike > 0.0 else "",
                alike,
            )
        )
    return tuple(out)


def _probe(study: Study, fit: Fit, white: Array, effect: Effect) -> _Probe:
    """An effect at its null, with every start's further parameters, and at its starts; `white`: the
    fit's whitened Jacobian (size, p).
    """
    problem = study.problem
    starts = [problem.nominal() | effect.at(s) for s in effect.starts]
    vanished = [problem.nominal() | effect.shrunk(s, 0.0) for s in effect.starts]
    changes = [
        None if isinstance(result, Exception) else result - study.nominal
        for result in problem.predict_many([(v, (effect.name,)) for v in (*vanished, *starts)])
    ]
    sizes, count = [float(_gaps_of(study, x).max()) for x in changes], len(starts)
    left = [x if x is None else _left(study, fit, white, x) for x in changes[count:]]
    return _Probe(effect, float(np.max(sizes[:count])), tuple(sizes[count:]), tuple(left))


def _shape(study: Study, change: Array) -> Array:
    """A change (size,) as the likelihood sees it, of length 1; 0 of nothing."""
    white = study.fitter.noise.whiten(np.where(study.problem.mask, change, 0.0))
    return np.asarray(white / max(float(np.linalg.norm(white)), TINY))


def _gaps_of(study: Study, change: Array | None) -> Array:
    """Floors of each observable (o,) that a change (size,) makes: beside what is measured it alone
    is the gap of a twin that is right. NaN without one.
    """
    if change is None:
        return np.full(len(study.problem.observables), np.nan)
    return np.asarray(np.nan_to_num(study.gauge.gaps(study.problem.y + change)))


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


def _widened(study: Study, found: Sequence[ObservableCheck]) -> list[str]:
    """Where refitting leaves materially more than the nominal twin does, and than its floor: by the
    likelihood the refitted values are better, so they pass on less of the noise that a prediction
    inherits (Fuller 1987, Measurement Error Models), or too few blocks tell of them.
    """
    limit = study.options.calibration.material**2
    names = [o.name for o in found if o.refitted**2 - max(o.gap, 1.0) ** 2 > limit]
    if not names:
        return []
    return [
        f"refitted parameters leave more of {', '.join(names)} than nominal ones: values that pass"
        " on less noise of what a prediction is made from look better than right ones (smooth that,"
        " or take fewer derivatives of it), other observables outweigh it, or too few blocks tell"
        " of the parameters"
    ]


def _said(study: Study, found: EffectCheck) -> list[str]:
    """What is wrong with an effect."""
    effect, out = study.problem.effects[found.name], []
    if not np.all(np.isfinite([found.at_null, *found.starts])):
        last = study.problem.budget.last_failure
        why = f": {last}" if found.name in last else ""
        out.append(f"the twin cannot simulate {found.name} at its null and all its starts{why}")
    if found.at_null > NEGLIGIBLE and effect.remainder is None:
        out.append(not_vanishing(effect))
    for start, change in zip(effect.starts, found.starts, strict=True):
        if change < NEGLIGIBLE:
            out.append(
                f"{found.name} changes nothing at {_at(start)}: these blocks do not exercise it, or"
                " the start is too small"
            )
    return out


def _at(start: Mapping[str, float]) -> str:
    """A start in words."""
    return ", ".join(f"{name} = {value:g}" for name, value in start.items())


def _silent(study: Study, name: str) -> list[str]:
    """Where an effect, and it alone, says nothing of a part of an observable that is not small."""
    problem, effect = study.problem, study.problem.effects[name]
    for start in effect.starts:
        nothing = problem.silent(problem.nominal() | effect.at(start), (name,))
        share = [
            float(np.mean(nothing[(problem.obs_of == o) & problem.mask])) for o in problem.present
        ]
        if max(share) > SMALL:
            o = problem.observables[problem.present[int(np.argmax(share))]].name
            return [
                f"{name} at {_at(start)} says nothing of {100 * max(share):.0f} % of {o}: the twin"
                " without it stands in there, and what that leaves counts as left; where no twin"
                f" can know {o} (the force that friction holds at rest), leave NaN without effects,"
                " too"
            ]
    return []


def _noisy(study: Study, found: EffectCheck) -> list[str]:
    """Where an effect follows the noise of what is spliced in before it, at a start that shows."""
    problem, name = study.problem, found.name
    effect = problem.effects[name]
    for start, change in zip(effect.starts, found.starts, strict=True):
        if not change > study.options.calibration.material:
            continue
        values = problem.nominal() | effect.at(start)
        followed = noise_followed(study.fitter.noise, values, name, study.seed)
        share = float(np.sum(followed))
        if share > SMALL:
            o = problem.observables[int(np.argmax(followed))].name
            return [
                f"{name} at {_at(start)} follows the noise of the measured signals, most in {o}: it"
                f" will be fitted too small, by up to {100 * min(share, 1.0):.0f} %; let `simulate`"
                " smooth what it takes from them"
            ]
    return []
