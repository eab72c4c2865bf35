"""Which hypotheses are admissible, and what they weigh."""

from __future__ import annotations

import numpy as np

from pianobot_ros.gap.score import difference, weights
from pianobot_ros.gap.study import Study, material, prior_cost
from pianobot_ros.gap.types import Array
from pianobot_ros.gap.verdict import log_priors


def admit(study: Study) -> None:
    """An effect counts only if it beats its parent held out, and its magnitude's interval excludes null."""
    calibration = study.options.calibration
    for e in study.entries:
        if not e.effects or e.fit is None:
            continue
        parents = [
            p for p in study.entries if p.name == "parameters" or (p.effects and set(p.effects) < set(e.effects))
        ]
        parent = max(parents, key=lambda p: float(p.scored.per_unit.sum()))
        gain, se = difference(study.problem, e.scored.per_unit, parent.scored.per_unit)
        e.admissible = gain > calibration.accept_sigma * se and e.gap < parent.gap
        if not material(study, parent.held_out):  # nothing left to gain, unless it takes odd parameters to get there
            e.admissible = (
                not material(study, e.held_out) and prior_cost(parent.fit) - prior_cost(e.fit) > calibration.implausible
            )
        elif len(e.effects) > 1:
            single = min((p for p in parents if p.effects), key=lambda p: p.gap, default=parent)
            e.admissible &= single.gap - e.gap > calibration.pair_share * max(study.entry("parameters").gap - 1.0, 1e-9)
        position = {n: i for i, n in enumerate(e.fit.space.names)}
        for name in e.effects:
            effect = study.problem.effects[name]
            j = position[effect.magnitude]
            null = e.fit.space.encode({effect.magnitude: effect.null})[j] if not effect_is_log(study, name) else -np.inf
            if abs(e.fit.v[j] - null) < 1.96 * e.fit.sd[j]:
                e.admissible = False


def alone(study: Study, effect: str) -> float:
    """Held-out score of an effect on its own: which of several together matters most."""
    return max((float(e.scored.per_unit.sum()) for e in study.entries if e.effects == (effect,)), default=-np.inf)


def effect_is_log(study: Study, name: str) -> bool:
    """Whether the effect's magnitude lives on a log scale (its null is then out of reach)."""
    effect = study.problem.effects[name]
    return any(p.log for p in effect.parameters if p.name == effect.magnitude)


def weigh(study: Study) -> Array:
    """Weight of every hypothesis on the table (m,), adding up to 1."""
    c = study.options.calibration
    prior = log_priors(
        [(e.name, e.effects) for e in study.entries], c, dict(study.options.prior), len(study.problem.effects)
    )
    prior = prior + np.array([0.0 if e.admissible else -4.0 - 1e3 * (len(e.effects) > 1) for e in study.entries])
    if not material(study, study.nominal):
        prior = prior + np.array([1e3 if e.name == "none" else 0.0 for e in study.entries])
    extra = {n: len(x.parameters) - 1 for n, x in study.problem.effects.items()}
    prior = prior + c.parameter_log_odds * np.array([float(sum(extra[n] for n in e.effects)) for e in study.entries])
    prior = prior - np.array([prior_cost(e.fit) for e in study.entries]) / c.prior_temperature
    scores = [e.scored.per_unit for e in study.entries]
    refit = study.entry("parameters")
    if not material(study, refit.held_out):  # differences below the floor decide nothing
        scores = [refit.scored.per_unit if e.name != "none" and not material(study, e.held_out) else s
                  for e, s in zip(study.entries, scores, strict=True)]  # fmt: skip
    return weights(study.problem, scores, prior, temperature(study), study.seed)


def temperature(study: Study) -> float:
    """Score difference that counts as one nat: never less than the laws' own precision."""
    c = study.options.calibration
    totals = {e.name: float(e.scored.per_unit.sum()) for e in study.entries}
    return max(c.temperature, c.law_precision * (max(totals.values()) - totals["parameters"]))
