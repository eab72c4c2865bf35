"""From hypotheses on the table to a Diagnosis: probabilities, verdict, closure, breakdown."""

from __future__ import annotations

import platform
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from scipy.special import ndtri

from pianobot_ros.gap.diagnosis import (
    Candidate,
    Closure,
    Diagnosis,
    Estimate,
    FoundEffect,
    Hypothesis,
    UnknownDescription,
    Verdict,
)
from pianobot_ros.gap.explain import breakdown
from pianobot_ros.gap.explain.describe import describe
from pianobot_ros.gap.explain.likeness import at_starts, cut_off, out_of_time, unlike_units
from pianobot_ros.gap.explain.offer import offer
from pianobot_ros.gap.explain.sentence import (
    of_noise,
    of_odd_values,
    of_readings,
    of_rivals,
    of_the_rest,
    sentence,
)
from pianobot_ros.gap.explain.shares import stage_shares
from pianobot_ros.gap.fitting.evidence import (
    anything,
    implausible,
    material,
    open_observables,
    prior_cost,
    told,
)
from pianobot_ros.gap.fitting.fit import Fit
from pianobot_ros.gap.fitting.intervals import by_chance, deviation
from pianobot_ros.gap.fitting.score import difference
from pianobot_ros.gap.posterior.decide import Judgement, decide
from pianobot_ros.gap.posterior.hidden import hiding
from pianobot_ros.gap.posterior.leftover import excess, perhaps_noise, unexplained
from pianobot_ros.gap.posterior.probabilities import Posterior, closure_of
from pianobot_ros.gap.posterior.table import inclusion
from pianobot_ros.gap.problem.constants import FAR, LEADERS, MOST, UPPER
from pianobot_ros.gap.problem.types import Array
from pianobot_ros.gap.search.study import Entry, Study, stretched

MEANING = {
    "none": "twin and robot agree",
    "parameters": "values are wrong, nothing is missing",
    "unknown": "a cause that the library lacks",
}
"""What the answers say that are no effect of the library."""


def conclude(found: Posterior) -> Diagnosis:
    """Decide by what the hypotheses are worth, and write it up."""
    study, judged = found.study, decide(found)
    problem, gauge = study.problem, study.gauge
    refit = study.entry("parameters")
    best, verdict = judged.best, judged.verdict
    closure = closure_of(study, best)
    stage_of = {n: e.stage for n, e in problem.effects.items()}
    what = MEANING | {n: e.description for n, e in problem.effects.items()}
    # what only looks like the cause would blur its description; and the values fitted beside an
    # effect make up for each other: without it they are no values of the cell
    left = refit if verdict == "unknown" else best
    before, after = (excess(study, e, found.noise) for e in (refit, best))
    own = _estimates(study, best, after)
    # what nothing was fitted to leaves open is what refitting leaves
    fitted = own if own and left is best else _estimates(study, refit, before)
    effects = tuple(
        FoundEffect(
            n,
            stage_of[n],
            inclusion(found.table, n),
            {p.name: own[p.name] for p in problem.effects[n].parameters},
        )
        for n in judged.named
    )
    rest = unexplained(study, before, after) if verdict == "effect" else {}
    unknown = (
        describe(gauge, left.held_out, rest)
        if anything(study) and material(study, left.held_out)
        else None
    )
    said = _sentence(study, judged, effects, closure, unknown, before - after, rest)
    return Diagnosis(
        verdict=verdict,
        sentence=" ".join(filter(None, said)),
        effects=effects,
        candidates=tuple(Candidate(n, stage_of.get(n, ""), p, what[n]) for n, p in judged.ranked),
        credible_set=judged.credible,
        stages=breakdown.stages(gauge, study.nominal, stage_shares(study)),
        phases=breakdown.phases(gauge, study.nominal),
        signals=breakdown.signals(gauge, study.nominal),
        gap=closure,
        inseparable=judged.inseparable,
        next_experiment=None,
        warnings=_warnings(study, left, best, verdict),
        runtime_s=problem.budget.elapsed(),
        closures=_closures(study, best),
        hypotheses=_hypotheses(study, found.table.weight),
        hiding=() if material(study, refit.held_out) else hiding(study, found.masses),
        parameters={p.name: fitted[p.name] for p in problem.parameters},
        offer=offer(study, left),
        stage_by_phase=breakdown.stage_by_phase(gauge, study.nominal, best.held_out),
        stage_by_condition=breakdown.stage_by_condition(gauge, study.nominal, best.held_out),
        traces=breakdown.traces(gauge, (study.nominal, refit.held_out, best.held_out)),
        unknown=unknown,
        provenance=_provenance(study),
    )


def _sentence(
    study: Study,
    judged: Judgement,
    effects: tuple[FoundEffect, ...],
    closure: Closure,
    unknown: UnknownDescription | None,
    gain: Array,
    rest: Mapping[str, float],
) -> Iterator[str]:
    """The verdict, with what it closes of each observable (o,), and what is to be said beside it:
    of the `rest` that it leaves, of what may be noise. Empty where there is nothing of it.
    """
    best, verdict = judged.best, judged.verdict
    rivals, odd = _rivals(judged), _odd(study, best) if verdict == "parameters" else {}
    yield sentence(
        verdict,
        effects,
        closure,
        unknown,
        judged.inseparable,
        _shows_in(study, gain),
        sure=0.0 if odd or (rivals and not effects) else judged.sure,
        nearest=best.effects,
    )
    yield of_odd_values(odd)
    yield of_rivals(rivals)
    if verdict != "unknown":
        yield "" if effects else of_readings(study.problem.taken_out)
        yield of_the_rest(rest, unknown, len(effects) < study.options.max_effects)
        yield of_noise(perhaps_noise(study, best))
    yield from (f"But {x}." for x in unlike_units(study))


def _rivals(judged: Judgement) -> dict[str, float]:
    """Names that are most of as likely as the verdict, and are none of those that it names or that
    cannot be told from them, with their probabilities.
    """
    named = set(judged.named) or {judged.verdict}
    named.update(*(group for group in judged.inseparable if named & set(group)))
    least = MOST * next(p for n, p in judged.ranked if n in named)
    return {n: p for n, p in judged.ranked if p >= least and n not in named}


def _odd(study: Study, best: Entry) -> dict[str, float]:
    """How many prior deviations a few parameters are off, by name, where what was refitted is
    implausible: the furthest, and others that nothing usual is as far off as.
    """
    if prior_cost(best.fit) <= implausible(study):
        return {}
    off = {p.name: abs(x) for p, x in zip(best.fit.space.parameters, best.fit.v, strict=True)}
    furthest = sorted(off, key=lambda name: -off[name])[:LEADERS]
    return {n: off[n] for n in furthest if n == furthest[0] or off[n] > FAR}


def _closures(study: Study, best: Entry) -> dict[str, Closure]:
    """How far each observable's own gap closes, by name."""
    refit = study.entry("parameters")
    return {
        study.problem.observables[o].name: study.gauge.closure(
            study.nominal, refit.held_out, best.held_out, study.seed, o
        )
        for o in study.problem.present
    }


def _provenance(study: Study) -> dict[str, Any]:
    """What the diagnosis rests on."""
    problem = study.problem
    return {
        "seed": study.seed,
        "simulate_calls": problem.budget.calls,
        "simulated_blocks": problem.budget.spent,
        "failed_simulations": problem.budget.failures,
        "blocks": len(problem.blocks),
        "conditions": len(problem.conditions),
        "samples": int(problem.mask.sum()),
        "effects_in_library": len(problem.effects),
        "python": platform.python_version(),
        "numpy": np.__version__,
    }


def _shows_in(study: Study, gain: Array) -> tuple[str, ...]:
    """The one or two observables in which a hypothesis closes most (o,) of what refitting
    leaves.
    """
    order = np.argsort(-gain)[:2]
    return tuple(
        study.problem.observables[o].name for o in order if gain[o] > max(MOST * gain.max(), 0.0)
    )


def _estimates(study: Study, entry: Entry, left: Array) -> dict[str, Estimate]:
    """What a fitted hypothesis, which leaves systematic squared gaps (o,), says of its parameters,
    by name.
    """
    fit = entry.fit
    if not len(fit.space):
        return {}
    half, fold_v = float(ndtri(UPPER)), entry.scored.fold_v
    whole = fit.space.interval(fit.v, half * deviation(study, fit, fold_v, left))
    again = fit.space.interval(fit.v, half * by_chance(fit, fold_v))
    bound, values = fit.space.at_bounds(fit.v), fit.values
    return {
        p.name: Estimate(
            values[p.name],
            *whole[p.name],
            p.unit,
            p.nominal,
            p.stage,
            p.name in bound,
            again[p.name],
        )
        for p in fit.space.parameters
    }


def _warnings(study: Study, left: Entry, best: Entry, verdict: Verdict) -> tuple[str, ...]:
    """All that is to be known beside the verdict, whose fit is `left`; `best` comes nearest."""
    said = [*_fit_warnings(study, left), *_in_few_blocks(study, left)]
    if verdict == "unknown":
        said += [*_idle(study), *cut_off(study)]
        said += at_starts(study, left.held_out) or out_of_time(study)
    elif verdict in MEANING:
        said += _excused(study, left)
    if best.effects and stretched(study, best):
        sizes = (study.problem.effects[n].size.name for n in best.effects)
        ends = ", ".join(f"{n} = {best.fit.values[n]:g}" for n in sizes)
        said.append(
            f"{best.name} is not named: its size is at the end of its range ({ends}), and a cause"
            " of that size is another one, unless that range is too narrow"
        )
    return told(study, *said).warnings


def _excused(study: Study, entry: Entry) -> list[str]:
    """Of observables most of what a hypothesis leaves of which is no scatter, and within what the
    twin may be wrong by.
    """
    problem, noise, out = study.problem, study.fitter.noise, []
    for o in problem.present:
        own, name = (problem.obs_of == o) & problem.mask, problem.observables[o].name
        rms = float(np.sqrt(np.mean((problem.y - entry.held_out)[own] ** 2)))
        known, unit = noise.estimates.noises[o], problem.observables[o].unit
        scatter = float(np.sqrt(max(noise.floor[o] ** 2 - known.tolerance**2, known.hint**2)))
        within = rms < (1.0 + study.options.calibration.material) * noise.floor[o]
        if within and scatter**2 < (1.0 - MOST) * rms**2:
            out.append(
                f"what is left of {name} ({rms:.3g} {unit} RMS) is more than its scatter"
                f" ({scatter:.3g}) and passes for an error of the twin ({known.tolerance:.3g}): if"
                " the twin is better than that, give a smaller Observable.tolerance"
            )
    return out


def _idle(study: Study) -> list[str]:
    """Of effects that changed nothing at any of their starts."""
    acting = {s.effect for s in study.signatures if s.change.any()}
    idle = [n for n in dict.fromkeys(s.effect for s in study.signatures) if n not in acting]
    if not idle:
        return []
    return [
        f"no start of {', '.join(idle)} changes anything, so no such effect can be named here:"
        " these recordings do not exercise it, or `simulate` does not know it by this name"
    ]


def _fit_warnings(study: Study, entry: Entry) -> list[str]:
    """What is to be known about the fit whose parameters are given, and about the search."""
    out = []
    if bound := _on_bounds(entry.fit):
        out.append(
            f"fitted value on its bound, often the sign of a missing effect: {', '.join(bound)}"
        )
    budget = study.problem.budget
    if budget.struck:
        out.append(
            f"stopped by the wall-clock limit of {budget.limit:.0f} s: with more time the answer"
            " may be another"
        )
    if budget.failures:
        said = f"the last: {budget.last_failure}"
        out.append(f"{budget.failures} simulations failed and were left out ({said})")
    return out


def _in_few_blocks(study: Study, entry: Entry) -> list[str]:
    """Of which recordings nearly all is that a hypothesis leaves of an observable."""
    problem, prediction = study.problem, entry.held_out
    wide = sorted(open_observables(study, prediction, sigma=0.0))  # an accident of blocks, too
    found = breakdown.in_few_blocks(study.gauge, prediction, wide)
    return [
        f"nearly all that is left of {name} is in {len(blocks)} of {len(problem.blocks)} blocks"
        f" ({problem.names_of(blocks)}): look at what happened there"
        for name, blocks in found.items()
    ]


def _on_bounds(fit: Fit) -> list[str]:
    """Names of the parameters that a fit holds on a bound. A part of a law that has the value
    believed is not there, and on none.
    """
    held, values = set(fit.space.at_bounds(fit.v)), fit.values
    free = (p for p in fit.space.parameters if not p.same(values[p.name], p.nominal))
    return [p.name for p in free if p.name in held]


def _hypotheses(study: Study, weight: Array) -> tuple[Hypothesis, ...]:
    reference = study.entry("parameters").scored.per_unit
    rows = []
    for e, w in zip(study.entries, weight, strict=True):
        gain, se = difference(study.problem, e.scored.per_unit, reference)
        rows.append(Hypothesis(e.effects, e.name, float(w), gain, se, e.gap, e.fit.values))
    return tuple(sorted(rows, key=lambda h: -h.probability))
