"""Fits carried on until none ends lower from where another one stands.

Valleys are long and have side arms, and each fit stops somewhere else. A hypothesis must not win
because another stopped early, so the foremost begin anew from what the others have found. Of two
hypotheses of which one is a special case of the other the general one can never cost more: where it
does, its fit is not at its end.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pianobot_ros.gap.fitting.evidence import told
from pianobot_ros.gap.problem.constants import HEAT, LEADERS, MOST, SMALL
from pianobot_ros.gap.problem.twin.special_cases import (
    from_special_case,
    reduced,
    to_special_case,
)
from pianobot_ros.gap.problem.types import Array
from pianobot_ros.gap.search.contenders import (
    gain,
    leaders,
    leaves_much,
    open_further,
    relieves,
    special_cases_of,
)
from pianobot_ros.gap.search.study import Entry, Study, affords, make_entry, put, standing

__all__ = ["add_members", "lead_converged", "settle", "without_one"]


def settle(study: Study) -> Study:
    """Fit the foremost hypotheses until none ends lower from where another one stands."""
    while True:
        before = [e.fit for e in study.entries]
        study = _add_special_cases(add_members(study))
        for of in (_leading, _simplest):
            for e in of(study):
                if not affords(study):
                    return told(
                        study,
                        "the budget did not allow fitting the leading hypotheses until they"
                        " converge",
                    )
                if of is _leading:
                    study = _converged(study, e)
                study = _from_elsewhere(study, study.entry(e.name))
        if len(before) == len(study.entries) and all(
            e.fit is fit for e, fit in zip(study.entries, before, strict=True)
        ):
            return study


def lead_converged(study: Study) -> Study:
    """Fit the leader to its end, and whoever leads then."""
    while leaders(study) and not leaders(study)[0].settled and affords(study):
        study = _converged(study, leaders(study)[0])
    return study


def _leading(study: Study) -> list[Entry]:
    """Leaders that gain enough to be compared in the end, and that relieve what their best special
    case leaves open: what does not is never named.
    """
    least = MOST * gain(study, leaders(study)[0])

    def best_special_case(e: Entry) -> Entry:
        return max(special_cases_of(study, e), key=lambda s: standing(study, s))

    return [
        e
        for e in leaders(study)[:LEADERS]
        if gain(study, e) >= least and relieves(study, best_special_case(e).held_out, e.held_out)
    ]


def _simplest(study: Study) -> list[Entry]:
    """Refitting alone and all single effects: only a start from elsewhere can tell whether they end
    lower.
    """
    return [study.entry("parameters"), *(e for e in study.entries if len(e.effects) == 1)]


def _converged(study: Study, e: Entry) -> Study:
    """A hypothesis fitted to its end from where it stands, once."""
    if e.settled:
        return study
    fit = study.fitter.refine(e.fit, study.options.max_iterations)
    best = leaders(study)[0]
    if gain(study, e) > MOST * gain(study, best) and open_further(study, fit.prediction):
        own = fit.beyond(study.entry("parameters").fit)
        fit = study.fitter.hop(fit, own, study.options.triage_iterations)
    return put(study, make_entry(study, fit, settled=True))


def _from_elsewhere(study: Study, e: Entry) -> Study:
    """Fit a hypothesis anew from what others have found, where that costs less as it stands; a
    rival of the best in any case, unless that leaves so much that it matters little which is
    nearest.
    """
    best = leaders(study)[0]
    if e is best or e.tried_from is best.fit:
        return study
    rival = gain(study, e) >= MOST * gain(study, best) and not leaves_much(study, best)
    fit, own = e.fit, study.fitter.cost(e.fit)
    like = fit.space.encode(fit.values | best.fit.values)
    trials = [like, *_near_special_cases(study, e, own)]
    cost_at = study.fitter.likelihood.cost_at
    v, cost = min(((v, cost_at(e.effects, fit.space, v)) for v in trials), key=lambda x: x[1])
    worth = (rival and e.effects) or cost < own
    begun = study.fitter.begun(e.effects, v, fit.jacobian) if worth else None
    if begun is not None:
        fit = study.fitter.refine(begun, HEAT)
        if relieves(study, study.entry("parameters").held_out, fit.prediction) or not e.effects:
            fit = study.fitter.refine(fit, study.options.max_iterations)
        if fit.cost < own:
            e = make_entry(study, fit, settled=True)
    return put(study, replace(e, tried_from=best.fit))


def _near_special_cases(study: Study, e: Entry, cost: float) -> Iterator[Array]:
    """Values of each special case that costs less than a hypothesis' own `cost`, with the size
    of the effects that it lacks, and with little of it: with none of it the costs are equal.
    """
    for s in special_cases_of(study, e):
        if study.fitter.cost(s.fit) >= cost:
            continue
        sizes = [study.problem.effects[n] for n in e.effects if n not in s.effects]
        known = from_special_case(study.problem.effects, e.effects, s.fit.values)
        for share in (1.0, SMALL):
            own = {
                x.magnitude: x.null + share * (e.fit.values[x.magnitude] - x.null) for x in sizes
            }
            yield study.fitter.space(e.effects).encode(dict(e.fit.values) | known | own)


def add_members(study: Study) -> Study:
    """Put the members of a leading pair on the table alone, from the pair's values: the shortlist
    may have left one out.
    """
    best = leaders(study)[0]
    there = {e.effects for e in study.entries}
    for name in best.effects if len(best.effects) > 1 else ():
        if (name,) not in there and affords(study):
            study = _special_case(study, best, (name,))
    return study


def _add_special_cases(study: Study) -> Study:
    """Put what is left of a rival's effects in their place on the table, from the rival's values,
    where it is not there or costs more where it stands.
    """
    least = MOST * gain(study, leaders(study)[0])
    for rival in [e for e in leaders(study) if gain(study, e) >= least]:
        for few in reduced(study.problem.effects, rival.effects):
            if affords(study):
                study = _special_case(study, rival, few)
        study = without_one(study, rival)
    return study


def without_one(study: Study, e: Entry) -> Study:
    """Put what a hypothesis of several effects is without one of them on the table, from its
    values, where that costs less as it stands than all its special cases there: a search that adds
    one effect to the other never comes back to whether the first is still needed, and a fit that
    ended on the way is helped along by an effect that is none.
    """
    if len(e.effects) < 2:
        return study
    least = min((study.fitter.cost(s.fit) for s in special_cases_of(study, e)), default=np.inf)
    for name in e.effects:
        few = tuple(n for n in e.effects if n != name)
        if not affords(study):
            continue
        space = study.fitter.space(few)
        if study.fitter.likelihood.cost_at(few, space, space.encode(e.fit.values)) < least:
            study = _special_case(study, e, few)
    return study


def _special_case(study: Study, e: Entry, few: tuple[str, ...]) -> Study:
    """Fit the special case `few` of a hypothesis from its values where it costs more."""
    there = next((x for x in study.entries if set(x.effects) == set(few)), None)
    own = np.inf if there is None else study.fitter.cost(there.fit)
    if own <= study.fitter.cost(e.fit):
        return study
    effects = few if there is None else there.effects
    values = to_special_case(study.problem.effects, e.effects, e.fit.values)
    begun = study.fitter.begun(effects, study.fitter.space(effects).encode(values))
    if begun is None or begun.cost >= own:
        return study
    fit = study.fitter.refine(begun, study.options.max_iterations)
    return put(study, make_entry(study, fit, settled=True))
