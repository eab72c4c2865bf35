"""What the hypotheses on the table are worth: the probability of every name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pianobot_ros.gap.diagnosis import Closure
from pianobot_ros.gap.fitting.evidence import anything, material, told
from pianobot_ros.gap.posterior.disturbance import disturbance
from pianobot_ros.gap.posterior.hidden import hidden_odds
from pianobot_ros.gap.posterior.judge import Admission, admit, weigh
from pianobot_ros.gap.posterior.leftover import common_noise, excess, material_part
from pianobot_ros.gap.posterior.table import Table, likeliest, masses_of, recalibrated
from pianobot_ros.gap.posterior.verdict import openness, rarity, unknown_probability
from pianobot_ros.gap.problem.constants import MOST, RARE, TINY
from pianobot_ros.gap.problem.options import Calibration
from pianobot_ros.gap.problem.types import Array
from pianobot_ros.gap.search.contenders import leaders
from pianobot_ros.gap.search.study import Entry, Study, gaps, simulated

__all__ = ["Left", "Posterior", "closure_of", "posterior"]


@dataclass(frozen=True)
class Left:
    """What a hypothesis leaves: the `share` (0 to 1) of the squared gap that refitting leaves, over
    all observables, and the `worst` systematic gap (floors); and the `rarity` of the hypothesis.
    """

    share: float
    worst: float
    rarity: float

    def unknown(self, calibration: Calibration) -> float:
        """Probability that structure is missing that no member of the library has."""
        return unknown_probability(calibration, self.share, self.worst, self.rarity)


@dataclass(frozen=True)
class Posterior:
    """What was weighed: the `study`, in which the folds of all hypotheses are simulated;
    the `table`, as sure as answers like it were right, with its `masses` by name of effect, "none",
    "parameters" and "unknown"; `best`: the foremost hypothesis, `named`: the foremost effect;
    `left`: what *unknown* was judged by, where anything is left; `noise`: what of that may be noise
    (o,), of all hypotheses (:func:`~pianobot_ros.gap.posterior.leftover.common_noise`).
    """

    study: Study
    admission: Admission
    table: Table
    masses: dict[str, float]
    best: Entry
    named: Entry | None
    left: Left | None
    noise: Array


def posterior(study: Study) -> Posterior:
    """Weigh what is on the table."""
    # A line knows of no jumps: one that was not simulated would seem to leave less.
    for e in (*leaders(study), study.entry("parameters")):
        study = simulated(study, e)
    admission = admit(study)
    # An effect that does not shrink the held-out gap for certain is not the cause, nor one that
    # shrinks nothing of what refitting leaves.
    while True:
        weight = weigh(study, admission)
        heaviest = study.entries[int(np.argmax(weight))]
        if heaviest.effects:
            heaviest = _foremost(study, admission, weight) or heaviest
        name = admission.general.get(heaviest.name, heaviest.name)  # as likely, and simpler
        best = study.entry(name)
        if not (best.effects and admission.admits(best)):
            break
        closure = closure_of(study, best)
        if closure.closed_low > 0.0 and not closure.closed_by_effect <= 0.0:
            break
        admission = admission.refusing(best)
    refit, nearest = study.entry("parameters"), best
    if not best.effects and material(study, refit.held_out):
        nearest = _foremost(study, admission, weight) or best
    may = [e for e in study.entries if e is nearest or (e.effects and admission.admits(e))]
    noise = common_noise(study, (*may, refit))
    study, weight, p_unknown, left = _unknown(study, weight, nearest, may, noise)
    weight, p_unknown = _without_unfit(study, admission, weight, p_unknown)
    weight = _near_the_floor(study, weight)
    table = Table(
        tuple(e.effects or (e.name,) for e in study.entries),
        weight,
        p_unknown,
        {} if material(study, refit.held_out) else hidden_odds(study, refit, study.screened),
        tuple(study.problem.effects),
    )
    table = recalibrated(table, study.options.calibration)
    masses = masses_of(table)
    named = _foremost(study, admission, table.weight)
    for e in study.entries:  # what hides may be likelier than all else
        hides = len(e.effects) == 1 and e.effects[0] in table.hidden
        if hides and masses[e.effects[0]] > MOST and not material(study, e.held_out):
            named = e
    return Posterior(study, admission, table, masses, best, named, left, noise)


def _foremost(study: Study, admission: Admission, weight: Array) -> Entry | None:
    """The hypothesis of those with effects that may be named whose effects are the likeliest, by
    what all of them weigh (m,).
    """
    known = zip(study.entries, weight.tolist(), strict=True)
    may = [(e, w) for e, w in known if e.effects and admission.admits(e)]
    chosen = likeliest([(e.effects, w) for e, w in may])
    return next((e for e, _ in may if set(e.effects) == chosen), None)


def closure_of(study: Study, best: Entry) -> Closure:
    """How far the gap closes by a hypothesis whose folds were simulated; nothing is left for an
    effect where refitting reaches the floor.
    """
    refit = study.entry("parameters")
    found = study.gauge.closure(study.nominal, refit.held_out, best.held_out, study.seed)
    if best.effects and material(study, refit.held_out):
        return found
    nothing = float("nan")
    return replace(
        found,
        closed_by_effect=nothing,
        closed_by_effect_low=nothing,
        closed_by_effect_high=nothing,
    )


def _left_by(study: Study, e: Entry, whole: float, noise: Array) -> Left | None:
    """What a hypothesis leaves of the `whole` that refitting leaves (floors² over all observables),
    where no more than so much is `noise` (o,): all of it without an effect; None where it leaves
    nothing material.
    """
    if not material(study, e.held_out):
        return None
    rest = excess(study, e, noise)
    left = float(material_part(study, rest).sum())
    share = left / whole if e.effects and whole > 0 else 1.0
    rare = rarity(study.options.calibration, len(e.effects), len(study.problem.effects))
    return Left(share, float(np.sqrt(1.0 + rest.max())), rare)


def _unknown(
    study: Study, weight: Array, best: Entry, may: Sequence[Entry], noise: Array
) -> tuple[Study, Array, float, Left | None]:
    """Weights (m,) of hypotheses beside an unknown cause, its probability, and what it was judged
    by: what the most complete of the library's members that `may` be named leaves beyond `noise`
    (o,). A gap that one of them explains, or that refitting closes, is not unknown, however little
    it weighs. What refitting leaves beside an effect is missing from it as from any other
    hypothesis. `best`: what comes nearest.
    """
    c, refit = study.options.calibration, study.entry("parameters")
    if not anything(study):
        return study, weight, 0.0, None
    hertz = disturbance(study, best)
    if hertz is not None:
        said = f"a disturbance of {hertz:.3g} Hz runs on its own clock, and {best.name} only looks"
        return told(study, f"{said} like it"), weight * c.mimic, 1.0 - c.mimic, None
    if bool(best.effects) == material(study, refit.held_out):
        may = [*may, refit]
    whole = float(material_part(study, excess(study, refit, noise)).sum())
    left = {e.name: _left_by(study, e, whole, noise) for e in may}
    unknown = {n: x.unknown(c) if x else c.mimic for n, x in left.items()}
    lacks = {n: replace(x, rarity=1.0).unknown(c) if x else c.mimic for n, x in left.items()}
    least = min(unknown, key=lambda n: (unknown[n], n != best.name))
    weight = _completed(study, weight, lacks) * (1.0 - unknown[least])
    return study, weight, unknown[least], left[least]


def _completed(study: Study, weight: Array, missing: Mapping[str, float]) -> Array:
    """Weights (m,) in which what a hypothesis is `missing` beyond the most complete is at work
    beside it: it goes to those that miss the least, by what they weigh.
    """
    names, least = [e.name for e in study.entries], min(missing.values())
    lacks = np.array([missing.get(n, least) for n in names])
    whole = np.array([n in missing for n in names]) & (lacks <= least)
    share = np.where(whole, np.maximum(weight, TINY), 0.0)
    spare = float(weight @ (lacks - least))
    return np.asarray((weight * (1.0 - lacks) + spare * share / share.sum()) / (1.0 - least))


def _near_the_floor(study: Study, weight: Array) -> Array:
    """Weights in which nothing is missing as far as the nominal twin's own gap hardly leaves the
    floor: how wrong a twin may be is known to its author, but not to a tenth. The same holds for
    *unknown* already.
    """
    real = openness(study.options.calibration, float(gaps(study, study.entry("none")).max()))
    none = np.array([e.name == "none" for e in study.entries])
    return np.where(none, weight + (1.0 - real) * float(weight[~none].sum()), weight * real)


def _without_unfit(
    study: Study, admission: Admission, weight: Array, p_unknown: float
) -> tuple[Array, float]:
    """Weights in which effects that may not be named never lead.

    What they had goes to "none", "parameters" and unknown: to unknown as far as refitting leaves a
    gap open.
    """
    unfit = np.array([bool(e.effects) and not admission.possible(e) for e in study.entries])
    mass = float(weight[unfit].sum())
    if mass <= RARE * (float(weight.sum()) + p_unknown):
        return weight, p_unknown
    left = float(gaps(study, study.entry("parameters")).max())
    unknown = openness(study.options.calibration, left)
    spare = mass - RARE
    weight = np.where(unfit, weight * RARE / mass, weight)
    plain = np.array([not e.effects for e in study.entries])
    known = np.where(plain, weight, 0.0)
    known = (
        known if known.sum() > 0 else 1.0 * (np.array([e.name for e in study.entries]) == "none")
    )
    return weight + spare * (1.0 - unknown) * known / known.sum(), p_unknown + spare * unknown
