"""What the hypotheses on the table are worth: the probability of every name."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pianobot_ros.gap.diagnosis import Closure
from pianobot_ros.gap.posterior.disturbance import disturbance
from pianobot_ros.gap.posterior.hidden import hidden_odds
from pianobot_ros.gap.posterior.judge import admit, weigh
from pianobot_ros.gap.posterior.leftover import excess, material_excess
from pianobot_ros.gap.posterior.table import Table, masses_of, recalibrated
from pianobot_ros.gap.posterior.verdict import openness, unknown_probability
from pianobot_ros.gap.problem.constants import UNFIT
from pianobot_ros.gap.problem.types import Array
from pianobot_ros.gap.search.study import (
    Entry,
    Study,
    anything,
    gaps,
    material,
    simulate_folds,
)

__all__ = ["Posterior", "closure_of", "posterior"]


@dataclass(frozen=True)
class Posterior:
    """The `table` as sure as answers like it were right, with its `masses` by name of effect,
    "none", "parameters" and "unknown"; `best` the foremost hypothesis.
    """

    table: Table
    masses: dict[str, float]
    best: Entry


def posterior(study: Study) -> Posterior:
    """Weigh what is on the table."""
    simulate_folds(study, study.entry("parameters"))
    admit(study)
    while True:  # an effect that does not shrink the held-out gap for certain is not the cause
        weight = weigh(study)
        best = study.entries[int(np.argmax(weight))]
        if not (best.effects and best.admissible and closure_of(study, best).closed_low <= 0.0):
            break
        best.admissible = False
    p_unknown = _unknown(study, weight, best)
    weight = weight * (1 - p_unknown)
    weight, p_unknown = _without_unfit(study, _without_idle(study, weight), p_unknown)
    table = Table(
        tuple(e.effects or (e.name,) for e in study.entries),
        weight,
        p_unknown,
        {} if material(study, study.entry("parameters").held_out) else hidden_odds(study),
        tuple(study.options.only or study.problem.effects),
    )
    table = recalibrated(table, study.options.calibration)
    return Posterior(table, masses_of(table), best)


def closure_of(study: Study, best: Entry) -> Closure:
    """How far the gap closes; nothing is left for an effect where refitting reaches the floor."""
    refit = study.entry("parameters")
    simulate_folds(study, best)
    if best.closure is not None:
        return best.closure
    best.closure = found = study.gauge.closure(
        study.nominal, refit.held_out, best.held_out, study.seed
    )
    if best.effects and material(study, refit.held_out):
        return found
    nothing = float("nan")
    best.closure = replace(
        found,
        closed_by_effect=nothing,
        closed_by_effect_low=nothing,
        closed_by_effect_high=nothing,
    )
    return best.closure


def _unknown(study: Study, weight: Array, best: Entry) -> float:
    """Probability that the cause is unknown. A gap that a member of the library explains is not,
    however little it weighs.
    """
    c, refit = study.options.calibration, study.entry("parameters")
    if best.name == "none" and not anything(study):
        return 0.0
    if not best.effects and material(study, refit.held_out):
        best = max(
            (e for e in study.entries if e.effects and e.admissible),
            default=best,
            key=lambda e: weight[study.entries.index(e)],
        )
    hertz = disturbance(study, best)
    if hertz is not None:
        study.warn(
            f"a disturbance of {hertz:.3g} Hz runs on its own clock, and {best.name} only looks"
            " like it"
        )
        return 1.0 - c.mimic
    if not material(study, best.held_out):
        return c.mimic
    left, whole = material_excess(study, best), material_excess(study, refit)
    share = float(left.sum() / whole.sum()) if best.effects and whole.sum() > 0 else 1.0
    return unknown_probability(c, share, _worst(study, best))


def _worst(study: Study, entry: Entry) -> float:
    """Largest systematic gap, in floors, that a hypothesis leaves."""
    return float(np.sqrt(1.0 + excess(study, entry).max()))


def _without_idle(study: Study, weight: Array) -> Array:
    """Weights in which "parameters" has none if refitting does not shrink the held-out gap: it goes
    to "none".
    """
    at = {e.name: k for k, e in enumerate(study.entries)}
    if study.entry("parameters").gap < study.entry("none").gap:
        return weight
    weight = weight.copy()
    weight[at["none"]] += weight[at["parameters"]]
    weight[at["parameters"]] = 0.0
    return weight


def _without_unfit(study: Study, weight: Array, p_unknown: float) -> tuple[Array, float]:
    """Weights in which effects that may not be named never lead.

    What they had goes to "none", "parameters" and unknown: to unknown as far as refitting leaves a
    gap open.
    """
    unfit = np.array([bool(e.effects) and not e.admissible for e in study.entries])
    mass = float(weight[unfit].sum())
    if mass <= UNFIT * (float(weight.sum()) + p_unknown):
        return weight, p_unknown
    left = float(gaps(study, study.entry("parameters")).max())
    unknown = openness(study.options.calibration, left)
    spare = mass - UNFIT
    weight = np.where(unfit, weight * UNFIT / mass, weight)
    plain = np.array([not e.effects for e in study.entries])
    known = np.where(plain, weight, 0.0)
    known = (
        known if known.sum() > 0 else 1.0 * (np.array([e.name for e in study.entries]) == "none")
    )
    return weight + spare * (1.0 - unknown) * known / known.sum(), p_unknown + spare * unknown
