"""Hypotheses with one effect more: screened on top of a fit, and the foremost of them fitted."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from pianobot_ros.gap.fitting.evidence import open_observables, told
from pianobot_ros.gap.fitting.fit import Fit
from pianobot_ros.gap.problem.constants import (
    HEAT,
    LEADERS,
    MOST,
    SMALL,
)
from pianobot_ros.gap.problem.types import Array
from pianobot_ros.gap.search.contenders import (
    gain,
    leaders,
    leaves_much,
    left,
    open_further,
    out_of_reach,
    relieves,
)
from pianobot_ros.gap.search.screening import (
    Screened,
    Signature,
    begin,
    relief,
    screen,
    shortlist,
    signatures,
    squared_gaps,
)
from pianobot_ros.gap.search.settle import add_members, without_one
from pianobot_ros.gap.search.study import Entry, Study, affords, make_entry, put, temperatures

Start = tuple[str, Mapping[str, float]]
"""An effect's name, and the values of its parameters from which it is fitted."""
Tell = Callable[[str, float], None]
"""Called with what is being fitted, and the share of the shortlist that is done."""


def starts(study: Study, names: Iterable[str]) -> list[Start]:
    """All starts of effects."""
    return [(n, start) for n in names for start in study.problem.effects[n].starts]


def screened(study: Study, base: Fit, known: Iterable[Signature]) -> list[Screened]:
    """The effects of the signatures `known` on top of a fit, best first."""
    return screen(study.fitter, base, known, study.ways, study.gauge, temperatures(study))


def _screen_on(study: Study, base: Fit, names: Sequence[str]) -> list[Screened]:
    """The foremost of the effects `names` on top of a fit that has effects already: chosen by their
    signatures at their best starts on the refitted parameters, screened by all on this fit.
    """
    best = {s.effect: s.start for s in study.screened}
    known = [s for s in study.signatures if s.effect in names and best.get(s.effect) == s.start]
    found = screened(study, base, known)
    chosen = shortlist(found, study.options.shortlist, open_observables(study, base.prediction))
    return _screened_at(study, base, starts(study, [s.effect for s in chosen]))


def screen_library(study: Study) -> Study:
    """The study with the whole library screened on top of the refitted parameters, by the
    signatures that it has or, where it has none, by what is simulated there.
    """
    fit = study.entry("parameters").fit
    known = study.signatures
    known = known or tuple(signatures(study.fitter, fit, starts(study, study.problem.effects)))
    return replace(study, signatures=known, screened=tuple(screened(study, fit, known)))


def _screened_at(study: Study, base: Fit, trials: Iterable[Start]) -> list[Screened]:
    """Effects on top of a fit, best first, by signatures that are simulated there."""
    return screened(study, base, signatures(study.fitter, base, trials))


def _much_is_left(study: Study) -> bool:
    """Whether the hypothesis that leaves the least leaves so much that others are looked for from
    elsewhere.
    """
    best = min([study.entry("parameters"), *leaders(study)], key=lambda e: left(study, e))
    return leaves_much(study, best) and open_further(study, best.held_out)


def _from_nominal(study: Study) -> Fit:
    """The twin without effects where its parameters belong, not fitted."""
    return study.fitter.start((), np.zeros(len(study.problem.parameters)))


def look_again(study: Study) -> Study:
    """Screen once more from the nominal parameters where no effect leaves little of the gap, and
    fit the foremost.

    Refitted parameters may have gone far to make up for a missing effect. From there its trace is
    not seen; from where they belong it is.
    """
    if not _much_is_left(study):
        return study
    best = {s.effect: [(s.effect, s.start)] for s in study.screened}
    tried = {e.effects[0] for e in study.entries if len(e.effects) == 1}
    names = [n for n in study.problem.effects if n not in tried]
    trials = [t for n in names for t in best.get(n) or starts(study, [n])]
    cost = len(study.problem.parameters) + len(trials)
    if not affords(study, LEADERS, cost):
        return told(study, "the budget did not allow looking again from the nominal parameters")
    base = _from_nominal(study)
    return _race(study, base, _screened_at(study, base, trials)[:LEADERS])


def look_from_all_starts(study: Study) -> Study:
    """Fit single effects, the foremost first, from each of their starts as the twin gives it, as
    long as all that was found leaves much of the gap.

    A start is chosen by a line from nothing to it. Of a law whose size is a shape as well, as a
    spring's period is, another size is another valley, and the line tells nothing of it: the right
    law may stand among the last.
    """
    if not _much_is_left(study):
        return study
    base, enough = _from_nominal(study), True
    for e in [e for e in leaders(study) if len(e.effects) == 1]:
        own = [study.fitter.space(e.effects).encode(start) for _, start in starts(study, e.effects)]
        if len(own) < 2:
            continue
        each = 1 + len(own[0]) - len(base.v) + HEAT
        if not affords(study, besides=len(own) * each):
            enough = False
            continue
        study = _from_all(study, base, e, own)
        if not _much_is_left(study):
            break
    said = "the budget did not allow fitting all effects from all their starts"
    return study if enough else told(study, said)


def _from_all(study: Study, base: Fit, e: Entry, own: Iterable[Array]) -> Study:
    """A hypothesis fitted a few steps from all of its `own` starts (p,), and further from the best,
    where that costs less than it does.
    """
    fitter = study.fitter
    begun = (fitter.begun(e.effects, v, base.jacobian) for v in own)
    fits = [fitter.refine(f, HEAT, f.beyond(base)) for f in begun if f is not None]
    if not fits:
        return study
    fit = min(fits, key=lambda f: f.cost)
    fit = fitter.refine(fit, study.options.triage_iterations, fit.beyond(base))
    return put(study, make_entry(study, fit)) if fit.cost < e.fit.cost else study


def look_beside(study: Study) -> Study:
    """Screen the relatives of a leading effect, those of its stage that are not on the table, from
    where its parameters lie without it, and fit those that gain as a rival does.

    What explains much lets the parameters go back to where they belong. A relative of it explains
    as much only from there; from where refitting alone had to put them its trace is not seen.
    """
    best = leaders(study)[0]
    if len(best.effects) != 1:
        return study
    effects = study.problem.effects
    (own,) = best.effects
    tried = {e.effects for e in study.entries}
    names = [n for n, e in effects.items() if e.stage == effects[own].stage and (n,) not in tried]
    trials = starts(study, names)
    if not trials:
        return study
    if not affords(study, besides=len(study.problem.parameters) + len(trials)):
        return told(study, "the budget did not allow looking for relatives of the leading effect")
    fitted = {p.name: best.fit.values[p.name] for p in effects[own].parameters}
    base = study.fitter.begun((), study.fitter.space(()).encode(best.fit.values))
    if base is None:
        return study
    found = _screened_at(study, base, [(own, fitted), *trials])
    least = MOST * max((s.gain for s in found if s.effect == own), default=np.inf)
    rivals = [s for s in found if s.effect != own and s.gain >= least]
    return _race(study, base, rivals[:LEADERS])


def fit_shortlist(
    study: Study, base: Fit, found: Sequence[Screened], count: int, tell: Tell | None = None
) -> Study:
    """Fit the foremost of what was `found` on top of `base` that is not on the table yet."""
    known = {frozenset(e.effects) for e in study.entries if e.effects}
    own = gain(study, study.entry(base.name))
    chosen = [
        s
        for s in shortlist(found, count, open_observables(study, base.prediction))
        if frozenset((*base.effects, s.effect)) not in known
        and not out_of_reach(study, own + s.gain)
    ]
    return _race(study, base, chosen, tell)


def grow(study: Study, beside: Collection[str] | None = None) -> Study:
    """Look for a further effect beside the best hypothesis that may have one more, and beside its
    rival, while it leaves enough open; only `beside` those of these names. Of what comes best then,
    what it is without one of its effects goes on the table before the budget is spent on rivals.
    """
    most, lead = study.options.max_effects, leaders(study)[0]
    if len(lead.effects) >= most and not open_further(study, lead.held_out):
        return study
    bases = [e for e in leaders(study) if len(e.effects) < most][:2]
    for base in bases:
        if base is not bases[0] and gain(study, base) <= MOST * gain(study, bases[0]):
            continue
        if not (beside is None or base.name in beside):
            continue
        others = [n for n in study.problem.effects if n not in base.effects]
        if not others or not open_further(study, base.held_out):
            continue
        study = _with_others(study, base)
        if not affords(study, 2):
            study = told(study, "the budget did not allow looking for a further effect")
            continue
        found = _screen_on(study, base.fit, others)
        study = fit_shortlist(study, base.fit, found, LEADERS)
        study = without_one(study, leaders(study)[0])
    return study


def _with_others(study: Study, base: Entry) -> Study:
    """Fit a hypothesis together with each effect on the table that leaves at most half of something
    that it leaves open, from the values of both: of two that act in different stages these are
    nearly those of the pair, and nothing need be looked for.
    """
    fitter, steps = study.fitter, study.options.triage_iterations
    own, wide = squared_gaps(study.gauge, base.held_out), open_observables(study, base.held_out)
    there = {frozenset(e.effects) for e in study.entries}
    for e in [e for e in leaders(study) if len(e.effects) == 1]:
        both = (*base.effects, *e.effects)
        gone = relief(own, squared_gaps(study.gauge, e.held_out))
        if set(both) in there or not any(gone[o] > MOST for o in wide) or not affords(study):
            continue
        v = fitter.space(both).encode({**e.fit.values, **base.fit.values})
        if (fit := fitter.begun(both, v, base.fit.jacobian)) is not None:
            fit = fitter.refine(fit, steps, fit.beyond(base.fit))
            study = put(study, make_entry(study, fit))
    return study


def grow_beside_members(study: Study) -> Study:
    """Look for a further effect beside what a leading pair brought to light: a member that the
    shortlist had left out, and that leads now among those which may have one more.
    """
    there = {e.name for e in study.entries}
    study = add_members(study)
    return grow(study, {e.name for e in study.entries} - there)


def _race(study: Study, base: Fit, chosen: Sequence[Screened], tell: Tell | None = None) -> Study:
    """Fit effects on top of `base`: a few steps each, and more only for those that do not fall far
    behind (racing; Maron and Moore 1994).
    """
    fitter, options = study.fitter, study.options
    temperature = temperatures(study)
    costs = fitter.likelihood.costs_of(base.prediction)

    def gained(fit: Fit) -> float:
        return float(((costs - fitter.likelihood.costs_of(fit.prediction)) / temperature).sum())

    fits: list[Fit] = []
    hopeful: list[bool] = []
    wide = open_observables(study, base.prediction)
    enough = 0.0
    for k, candidate in enumerate(chosen):
        # a line may predict left-out conditions badly where the whole law does not: what relieves
        # an open observable is fitted as long as nothing else explains it
        if candidate.gain < SMALL * enough and (enough or not candidate.relieves(wide)):
            continue
        if tell:
            tell(f"fitting {candidate.effect}", k / len(chosen))
        if k and not study.problem.allows(10.0 + 3 * HEAT):
            study = told(study, f"the budget allowed {k} of {len(chosen)} shortlisted effects")
            break
        begun = begin(fitter, base, candidate)
        if not begun:
            continue
        columns = begun[0].beyond(base)
        further = columns[1:]
        fit = min((fitter.refine(f, HEAT, columns) for f in begun), key=lambda f: f.cost)
        hope = candidate.relieves(wide) or relieves(study, base.prediction, fit.prediction)
        if hope and further and open_further(study, fit.prediction):
            # a law of several parameters has several valleys, and its starts differ in few of them
            fit = fitter.hop(fit, further, HEAT, rounds=1)
        fits.append(fit)
        hopeful.append(hope)
        if not open_further(study, fit.prediction):
            enough = max(enough, gained(fit))
    most = max((gained(f) for f in fits), default=0.0)
    left = options.triage_iterations - HEAT
    for k, fit in enumerate(fits):
        if hopeful[k] and gained(fit) >= MOST * most and study.problem.allows(3 * left):
            fits[k] = fitter.refine(fit, left, fit.beyond(base))
    return put(study, *(make_entry(study, fit) for fit in fits))
