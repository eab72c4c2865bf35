"""From hypotheses on the table to a Diagnosis: probabilities, verdict, closure, tables."""

from __future__ import annotations

import platform

import numpy as np

from pianobot_ros.gap.constancy import variation
from pianobot_ros.gap.describe import describe
from pianobot_ros.gap.diagnosis import Candidate, Diagnosis, Estimate, FoundEffect, Hypothesis
from pianobot_ros.gap.disturbance import disturbance
from pianobot_ros.gap.hidden import hidden_odds
from pianobot_ros.gap.judge import admit, alone, tempered, weigh
from pianobot_ros.gap.measure import closed
from pianobot_ros.gap.score import difference
from pianobot_ros.gap.separability import groups
from pianobot_ros.gap.shares import stage_shares
from pianobot_ros.gap.study import Entry, Study, gaps, material
from pianobot_ros.gap.traces import traces
from pianobot_ros.gap.types import Array
from pianobot_ros.gap.verdict import credible_set, unknown_probability
from pianobot_ros.gap.words import sentence


def conclude(study: Study) -> Diagnosis:
    """Weigh what is on the table and write it up."""
    problem = study.problem
    admit(study)
    refit = study.entry("parameters")
    while True:  # an effect that does not shrink the held-out gap for certain is not the cause
        weight = weigh(study)
        best = study.entries[int(np.argmax(weight))]
        closure = study.gauge.closure(study.nominal, refit.held_out, best.held_out, study.seed)
        if not (best.effects and best.admissible and closure.closed_low <= 0.0):
            break
        best.admissible = False
    p_unknown = _unknown(study, weight, best)
    weight = weight * (1 - p_unknown)
    weight, p_unknown = _without_unfit(study, _without_idle(study, weight), p_unknown)
    scores = [(e.name, e.effects, tempered(study, e), e.admissible) for e in study.entries]
    inseparable = groups(problem, study.fitter, scores, refit.fit, study.screened)
    masses = _masses(study, weight, p_unknown)
    named = max((e for e in study.entries if e.admissible and e.effects), default=None,
                key=lambda e: weight[study.entries.index(e)])  # fmt: skip
    alike = (
        set() if named is None else set(named.effects).union(*(g for g in inseparable if set(g) & set(named.effects)))
    )
    totals = {"effect": sum(masses[n] for n in alike), "parameters": masses["parameters"], "none": masses["none"],
              "unknown": p_unknown}  # fmt: skip
    verdict = max(totals, key=lambda k: totals[k])
    if verdict == "effect" and named is not None:
        best = named
        closure = study.gauge.closure(study.nominal, refit.held_out, best.held_out, study.seed)
    if verdict in ("parameters", "none"):
        best = study.entry(verdict)
        closure = study.gauge.closure(study.nominal, refit.held_out, best.held_out, study.seed)
    ordered = sorted(masses.items(), key=lambda kv: -kv[1])
    if verdict == "effect":  # the effects of the verdict lead, strongest first
        lead = sorted(best.effects, key=lambda n: (-alone(study, n), -masses[n]))
        ordered = [(n, masses[n]) for n in lead] + [kv for kv in ordered if kv[0] not in lead]
    stage_of = {n: problem.effects[n].stage for n in problem.effects}
    candidates = tuple(Candidate(n, stage_of.get(n, ""), p) for n, p in ordered)
    names, probabilities = [c.name for c in candidates], [c.probability for c in candidates]
    effects = tuple(FoundEffect(n, stage_of[n], _inclusion(study, weight, n), _estimates(study, best, n))
                    for n in (x for x in names if verdict == "effect" and x in best.effects))  # fmt: skip
    _fit_warnings(study, best)
    # what imitates a disturbance would only blur its description
    left = refit if verdict == "unknown" and disturbance(study, best) is not None else best
    unknown = (
        describe(problem, study.gauge, study.fitter.noise, left.held_out) if material(study, left.held_out) else None
    )
    shares = stage_shares(study.problem, study.fitter, study.gauge, refit.fit, study.screened, study.nominal)
    credible = credible_set(names, probabilities)
    inseparable = tuple(g for g in inseparable if set(g) & {*credible, *best.effects})
    signals = study.gauge.signals(study.nominal)
    return Diagnosis(
        verdict=verdict,  # type: ignore[arg-type]
        sentence=sentence(verdict, effects, closure, unknown, inseparable),
        effects=effects,
        candidates=candidates,
        credible_set=credible,
        stages=study.gauge.stages(study.nominal, shares),
        phases=study.gauge.phases(study.nominal),
        signals=signals,
        gap=closure,
        inseparable=inseparable,
        next_experiment=None,
        warnings=tuple(study.warnings),
        runtime_s=study.clock.elapsed(),
        closures={
            problem.observables[o].name: study.gauge.closure(study.nominal, refit.held_out, best.held_out, study.seed, o, 100)
            for o in problem.present
        },
        hypotheses=_hypotheses(study, weight),
        parameters=_nuisances(study, best),
        stage_by_phase=study.gauge.stage_by_phase(study.nominal, best.held_out),
        stage_by_condition=study.gauge.stage_by_condition(study.nominal, best.held_out),
        traces=traces(problem, study.gauge, study.fitter.noise, study.nominal, best.held_out),
        unknown=unknown,
        provenance={"seed": study.seed, "simulate_calls": problem.calls, "simulate_seconds": problem.sim_seconds,
                    "failed_simulations": problem.failures, "blocks": len(problem.blocks),
                    "conditions": len(problem.conditions), "samples": int(problem.mask.sum()),
                    "effects_in_library": len(problem.effects), "python": platform.python_version(),
                    "numpy": np.__version__},
    )  # fmt: skip


def _masses(study: Study, weight: Array, p_unknown: float) -> dict[str, float]:
    """Probability by name; a pair's is shared between its members, and effects that may hide share that of "parameters"."""
    masses = {"none": 0.0, "parameters": 0.0, "unknown": p_unknown}
    masses |= dict.fromkeys(study.options.only or study.problem.effects, 0.0)
    for e, w in zip(study.entries, weight, strict=True):
        for name in e.effects or (e.name,):
            masses[name] += float(w) / max(len(e.effects), 1)
    if not material(study, study.entry("parameters").held_out):
        odds = hidden_odds(study)
        masses["parameters"] /= 1.0 + sum(odds.values())
        for name, own in odds.items():
            masses[name] += masses["parameters"] * own
    return masses


def _inclusion(study: Study, weight: Array, effect: str) -> float:
    """Probability that an effect is at work, alone or with others."""
    return min(1.0, sum(float(w) for e, w in zip(study.entries, weight, strict=True) if effect in e.effects))


def _unknown(study: Study, weight: Array, best: Entry) -> float:
    """Probability that the cause is unknown. A gap that a member of the library explains is not, however little it weighs."""
    if not best.effects and material(study, best.held_out):
        best = max((e for e in study.entries if e.effects and e.admissible), default=best,
                   key=lambda e: weight[study.entries.index(e)])  # fmt: skip
    elif best.name == "none":
        return 0.0
    least = _mimic(study, best)
    if not material(study, best.held_out):
        return least
    # wrong values may be most of the gap: what counts is what they leave
    share = closed(study.entry("parameters").gap, best.gap)
    open_share = 1.0 if not best.effects else 1.0 - max(share, 0.0) if np.isfinite(share) else 0.0
    return max(least, unknown_probability(study.options.calibration, open_share, *_left(study, best)))


def _mimic(study: Study, best: Entry) -> float:
    """Probability that the cause only looks like what is claimed, more so where an effect's size would have to vary."""
    c = study.options.calibration
    hertz = disturbance(study, best)
    if hertz is not None:
        study.warn(f"a disturbance of {hertz:.3g} Hz runs on its own clock, and {best.name} only looks like it")
        return 1.0 - c.mimic
    found = variation(study, best)
    if found is None:
        return c.mimic
    gain = float((tempered(study, best) - tempered(study, study.entry("parameters"))).sum())
    more = max(found.gain - c.varies * gain, 0.0)
    if more > c.varies_said:
        study.warn(
            f"{found.effect} would have to vary with {found.attribute}: the cause may be another one that looks like it"
        )
    return float(1.0 / (1.0 + (1.0 / c.mimic - 1.0) * np.exp(-min(more, 50.0))))


def _left(study: Study, best: Entry) -> tuple[float, float]:
    """Gap of the worst observable in floors, and the share of the squared gap above the floor there that refitting left too.

    An inexact law leaves many floors of a gap that was far larger; what the library lacks leaves it as it was.
    """
    own = gaps(study, best)
    worst = int(np.argmax(own))
    left, refit = float(own[worst]), float(gaps(study, study.entry("parameters"))[worst])
    return left, (left**2 - 1.0) / (refit**2 - 1.0) if refit > left > 1.0 else 1.0


def _without_idle(study: Study, weight: Array) -> Array:
    """Weights in which "parameters" has none if refitting does not shrink the held-out gap: it goes to "none"."""
    at = {e.name: k for k, e in enumerate(study.entries)}
    if study.entry("parameters").gap < study.entry("none").gap:
        return weight
    weight = weight.copy()
    weight[at["none"]] += weight[at["parameters"]]
    weight[at["parameters"]] = 0.0
    return weight


def _without_unfit(study: Study, weight: Array, p_unknown: float) -> tuple[Array, float]:
    """Weights in which effects that may not be named never lead.

    What they had goes to "none", "parameters" and unknown: to unknown as far as refitting leaves a gap open.
    """
    unfit = np.array([bool(e.effects) and not e.admissible for e in study.entries])
    mass, most = float(weight[unfit].sum()), 0.3
    if mass <= most * (float(weight.sum()) + p_unknown):
        return weight, p_unknown
    left = float(gaps(study, study.entry("parameters")).max())
    unknown = unknown_probability(study.options.calibration, 1.0, left)
    spare = mass - most
    weight = np.where(unfit, weight * most / mass, weight)
    plain = np.array([not e.effects for e in study.entries])
    known = np.where(plain, weight, 0.0)
    known = known if known.sum() > 0 else 1.0 * (np.array([e.name for e in study.entries]) == "none")
    return weight + spare * (1.0 - unknown) * known / known.sum(), p_unknown + spare * unknown


def _estimates(study: Study, entry: Entry, effect: str) -> dict[str, Estimate]:
    own = {p.name for p in study.problem.effects[effect].parameters}
    return {n: e for n, e in _all_estimates(study, entry).items() if n in own}


def _nuisances(study: Study, entry: Entry) -> dict[str, Estimate]:
    own = {p.name for p in study.problem.parameters}
    if entry.fit is None:
        return {
            p.name: Estimate(p.nominal, p.nominal, p.nominal, p.unit, p.nominal, p.stage)
            for p in study.problem.parameters
        }
    return {n: e for n, e in _all_estimates(study, entry).items() if n in own}


def _all_estimates(study: Study, entry: Entry) -> dict[str, Estimate]:
    fit = entry.fit
    assert fit is not None
    spread = np.std(entry.scored.fold_v, axis=0) if len(entry.scored.fold_v) > 1 else np.zeros(len(fit.space))
    intervals = fit.space.interval(fit.v, np.hypot(fit.sd, spread))
    bound = set(fit.space.at_bounds(fit.v))
    return {p.name: Estimate(fit.values[p.name], *intervals[p.name], p.unit, p.nominal, p.stage, p.name in bound)
            for p in fit.space.parameters}  # fmt: skip


def _fit_warnings(study: Study, entry: Entry) -> None:
    if entry.fit is None:
        return
    bound = entry.fit.space.at_bounds(entry.fit.v)
    if bound:
        study.warn(f"fitted value on its bound, often the sign of a missing effect: {', '.join(bound)}")
    if len(entry.scored.fold_v) > 1:
        wander = np.ptp(entry.scored.fold_v, axis=0) / np.maximum(4 * entry.fit.sd, 0.05)
        moving = [n for n, w in zip(entry.fit.space.names, wander, strict=True) if w > 3]
        if moving:
            study.warn(f"values that change with the blocks they are fitted to: {', '.join(moving[:6])}")
    if study.problem.failures:
        study.warn(f"{study.problem.failures} simulations failed and were left out")


def _hypotheses(study: Study, weight: Array) -> tuple[Hypothesis, ...]:
    reference = study.entry("parameters").scored.per_unit
    rows = []
    for e, w in zip(study.entries, weight, strict=True):
        gain, se = difference(study.problem, e.scored.per_unit, reference)
        rows.append(Hypothesis(e.effects, e.name, float(w), gain, se, e.gap, e.fit.values if e.fit is not None else {}))
    return tuple(sorted(rows, key=lambda h: -h.probability))
