"""Which hypotheses may be named, and what they weigh."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from pianobot_ros.gap.fitting.evidence import (
    anything,
    implausible,
    material,
    open_observables,
    prior_cost,
)
from pianobot_ros.gap.fitting.score import sureness, weights
from pianobot_ros.gap.posterior.hidden import likelier
from pianobot_ros.gap.posterior.verdict import log_priors
from pianobot_ros.gap.problem.constants import LEVEL, MOST, SMALL, TINY
from pianobot_ros.gap.problem.twin.special_cases import reduced
from pianobot_ros.gap.problem.types import Array
from pianobot_ros.gap.search.contenders import special_cases_of
from pianobot_ros.gap.search.grow import screened
from pianobot_ros.gap.search.study import (
    Entry,
    Study,
    gaps,
    standing,
    stretched,
    temperatures,
    tempered,
)

__all__ = ["ALL", "Admission", "admit", "alone", "surely_better", "weigh"]


@dataclass(frozen=True)
class Admission:
    """Names of the hypotheses that may not be named, and of those among them that one which may is
    plainly better than; `general`: those that do no more than the special case whose name follows,
    or are not told apart from the one whose name follows. They stay possible, and lead nowhere.
    """

    refused: frozenset[str] = frozenset()
    dominated: frozenset[str] = frozenset()
    general: Mapping[str, str] = field(default_factory=dict)

    def admits(self, e: Entry) -> bool:
        """Whether a hypothesis may be named."""
        return e.name not in self.refused

    def possible(self, e: Entry) -> bool:
        """Whether it may be the truth, though a special case of it be named."""
        return self.admits(e) or e.name in self.general

    def refusing(self, e: Entry) -> Admission:
        """The same without a hypothesis, and without those that stand behind it."""
        general = {n: s for n, s in self.general.items() if s != e.name}
        return replace(self, refused=self.refused | {e.name}, general=general)


ALL = Admission()
"""What is on the table while the search is under way."""


def admit(study: Study) -> Admission:
    """Which effects may be named.

    An effect counts if the data fit worse without it, it leaves less held-out gap than the nominal
    twin does, and either it beats its parent held out by a share worth naming, or it is as good as
    its parent without the parent's odd parameters (a missing effect that implausible values have
    absorbed). It does not count if another one is plainly better, or if it would have to be larger
    than it can be.
    """
    nominal = study.entry("none").gap
    fitted = [e for e in study.entries if e.effects]
    sound = [
        e
        for e in fitted
        if e.gap < nominal and not stretched(study, e) and _every_effect_matters(study, e)
    ]
    admitted = [e for e in sound if _worth_naming(study, e)]
    squares = {e.name: gaps(study, e) ** 2 for e in fitted}
    dominated = frozenset(
        e.name
        for e in fitted
        if any(_dominates(study, f, squares, e) for f in admitted if f is not e)
    )
    refused = [e for e in fitted if e not in admitted]
    may = [e for e in admitted if e.name not in dominated]
    unsure = [e for e in sound if e not in admitted and e.name not in dominated]
    by_effects = {frozenset(e.effects): e.name for e in may}
    general = {
        e.name: by_effects[frozenset(few)]
        for e in refused
        for few in reduced(study.problem.effects, e.effects)
        if frozenset(few) in by_effects
    }
    general = _not_told_apart(study, unsure, may) | general
    return Admission(dominated | {e.name for e in refused}, dominated, general)


def _not_told_apart(
    study: Study, unsure: Sequence[Entry], admitted: Sequence[Entry]
) -> dict[str, str]:
    """Of hypotheses that are not named since it is not quite sure that they are better than what
    they are built on, those that are as good as one that is, which is not surely better: what is
    said of the one holds for the other. The foremost such one by name.
    """
    c, found = study.options.calibration, {}
    for e in unsure:
        rivals = (f for f in admitted if len(f.effects) == len(e.effects))
        best = max(rivals, key=lambda f: standing(study, f), default=None)
        if best is None or not _worth_naming(study, e, surely=False):
            continue
        own, other = tempered(study, e), tempered(study, best)
        if sureness(study.problem, other, own, study.seed) <= c.accept:
            found[e.name] = best.name
    return found


def _worth_naming(study: Study, e: Entry, surely: bool = True) -> bool:
    """Whether a hypothesis does enough beyond what it is built on; ``surely``, or as it seems."""
    c = study.options.calibration
    parents = special_cases_of(study, e)
    parent = max(parents, key=lambda p: standing(study, p))
    as_good = e.gap**2 - parent.gap**2 < c.material**2
    natural = as_good and _odder(study, parent, e)
    if not material(study, parent.held_out):
        # nothing left to gain, unless it takes odd parameters to get there or something hides
        return (natural or _hides(study, parent, e)) and not material(study, e.held_out)
    own, built_on = (tempered(study, x, parent) for x in (e, parent))
    sure = sureness(study.problem, own, built_on, study.seed)
    simpler = min((p for p in parents if p.effects), key=lambda p: p.gap, default=parent)
    # what refitting closes by odd values shows a missing effect; of a further one it shows a false
    bought = len(e.effects) > 1 and _odder(study, e, simpler, _acting(study, e, simpler))
    enough = sure > c.accept or not surely
    where = surely_better(study, simpler, e) if surely else None
    better = enough and e.gap < parent.gap and _relieves_enough(study, simpler, e, where)
    return (better and not bought) or (len(e.effects) == 1 and natural and sure > 1.0 - c.accept)


def _hides(study: Study, parent: Entry, e: Entry) -> bool:
    """Whether what `e` has beside the effects of its parent, which leave nothing, is likelier to be
    at work than not. What hides behind parameters alone is weighed by its odds.
    """
    beside = set(e.effects) - set(parent.effects)
    if not parent.effects or len(beside) != 1:
        return False
    own = [s for s in study.signatures if s.effect in beside]
    return bool(likelier(study, parent, screened(study, parent.fit, own)))


def surely_better(study: Study, before: Entry, after: Entry) -> NDArray[np.bool_]:
    """Which observables (o,) `after` surely predicts better than `before`."""
    more = (after.scored.each - before.scored.each) / temperatures(study)
    sure = [sureness(study.problem, d, np.zeros_like(d), study.seed) for d in more.T]
    return np.array(sure) > study.options.calibration.accept


def _relieves_enough(
    study: Study, before: Entry, after: Entry, where: NDArray[np.bool_] | None = None
) -> bool:
    """Whether `after` closes enough of the squared gap above the floor that `before` leaves open:
    `effect_share` of it, and `pair_share` as far as it may be what an effect of `before` leaves
    since its law is inexact, which another law follows in part.

    How much that may be goes by what it explains of an observable (`imprecision`): where it
    explains nothing, nothing is left by it. Of what `before` leaves, not of the whole: what an
    inexact law leaves has no shape that another law would follow far, however much or little it
    is. So `further` floors may be left where most is its own, and elsewhere what is not material.
    An inexact law is wrong in all that it explains, and the least of that a single number may
    follow: such observables are judged together, every other one alone.
    What it opened itself and refitting alone had not is no relief, and what `after` opens elsewhere
    is taken off: a flexible law can move misfit from one observable to another. Only relief in
    observables (o,) `where` it is sure counts (all by default): where nothing repeats folds differ,
    and a law that is sure of a wheel had its relief of an angle that it does not act on.
    """
    c = study.options.calibration
    a, b, refit = (gaps(study, e) ** 2 for e in (before, after, study.entry("parameters")))
    a, b = np.maximum(a, 1.0), np.maximum(b, 1.0)  # below the floor nothing is closed
    opened = float(np.maximum(b - a, 0.0).sum())
    inexact = c.imprecision / (1.0 - c.imprecision) * np.maximum(refit - a, 0.0)
    own = np.minimum(inexact, a - 1.0)
    gain = np.minimum(a, refit) - b
    gain = gain if where is None else np.where(where, gain, np.minimum(gain, 0.0))
    spare = gain - c.effect_share * (a - 1.0 - own) - c.pair_share * own
    mostly = own > MOST * (a - 1.0)
    least = np.where(mostly, c.further, c.material)
    wide = open_observables(study, before.held_out, least, sigma=0.0)
    together = [[o for o in wide if mostly[o]], *([o] for o in wide if not mostly[o])]
    return any(float(spare[group].sum()) > opened for group in together)


def _dominates(study: Study, better: Entry, squares: Mapping[str, Array], e: Entry) -> bool:
    """Whether `better`, with no more effects than `e` and parameters that are not far odder, leaves
    plainly less of some observable (`further`), and of the others more by what is not material, or
    small beside that.

    `squares` are squared gaps (o,) by hypothesis. The log score rewards a flexible effect for what
    it shaves off thousands of samples within the floor; the floor does not.
    """
    if len(better.effects) > len(e.effects):
        return False
    c = study.options.calibration
    least, own = squares[better.name], squares[e.name]
    gain = np.maximum(own - np.maximum(least, 1.0), 0.0)
    loss = np.maximum(least - np.maximum(own, 1.0), 0.0)
    enough = max(c.material**2, SMALL * float(gain.sum()))
    less = bool(gain.max() > c.further**2 and loss.sum() < enough)
    return less and not _odder(study, better, e)


def _odder(study: Study, a: Entry, b: Entry, which: NDArray[np.bool_] | None = None) -> bool:
    """Whether the parameters of `a` are further from what was believed than those of `b`, by what
    is :func:`implausible`; `which` of them (p,) are asked (default: all). An effect may have what
    shape it likes.
    """
    own = slice(len(study.problem.parameters)) if which is None else np.flatnonzero(which)
    return prior_cost(a.fit, own) - prior_cost(b.fit, own) > implausible(study)


def _acting(study: Study, e: Entry, before: Entry) -> NDArray[np.bool_]:
    """Which of the twin's parameters (p,) act on an observable of whose gap `e` closes as much as
    an effect must of what `before` leaves. By no other one is it closed: where the law of the
    first effect drives parameters of its stage far, a further one elsewhere has no part in it.
    """
    a, b = (np.maximum(gaps(study, x) ** 2, 1.0) for x in (before, e))
    closed = a - b > study.options.calibration.effect_share * (a - 1.0)
    rows = closed[study.problem.obs_of] & study.problem.mask
    return np.asarray(np.any(e.fit.jacobian[rows, : len(study.problem.parameters)] != 0.0, axis=0))


def _every_effect_matters(study: Study, e: Entry) -> bool:
    """Likelihood ratio of the hypothesis without each of its effects, and with what is left of it.

    An interval of the magnitude would not do: of an effect with several parameters each alone may
    be undetermined.
    """
    own = study.fitter.cost(e.fit)
    fits = {frozenset(x.effects): x.fit for x in study.entries if x.name != "none"}
    fewer = [tuple(n for n in e.effects if n != name) for name in e.effects]
    for few in (*fewer, *reduced(study.problem.effects, e.effects)):
        without = fits.get(frozenset(few))
        if without is None:
            continue
        limit = 0.5 * float(chdtri(len(e.fit.space) - len(without.space), 1.0 - LEVEL))
        if study.fitter.cost(without) - own < limit:
            return False
    return True


def alone(study: Study, effect: str) -> float:
    """Held-out score of an effect on its own: which of several together matters most."""
    own = (standing(study, e) for e in study.entries if e.effects == (effect,))
    return max(own, default=-np.inf)


def weigh(study: Study, admission: Admission = ALL) -> Array:
    """Weight of every hypothesis on the table (m,), adding up to 1."""
    c = study.options.calibration
    named = [(e.name, e.effects) for e in study.entries]
    prior = log_priors(named, c, len(study.problem.effects))
    unfit = [
        0.0
        if admission.possible(e)
        else -np.inf
        if len(e.effects) > 1 or e.name in admission.dominated
        else float(np.log(c.certain))
        for e in study.entries
    ]
    prior = prior + np.array(unfit)
    if not anything(study):
        prior = np.where([e.name == "none" for e in study.entries], 0.0, -np.inf)
    extra = {n: len(x.parameters) - 1 for n, x in study.problem.effects.items()}
    prior = prior + c.parameter_log_odds * np.array(
        [float(sum(extra[n] for n in e.effects)) for e in study.entries]
    )
    prior = prior - np.array([prior_cost(e.fit) for e in study.entries]) / c.prior_temperature
    scores = [_weighed(study, e) for e in study.entries]
    refit = study.entry("parameters")
    if not material(study, refit.held_out):  # differences below the floor decide nothing
        scores = [
            tempered(study, refit) if e.name != "none" and not material(study, e.held_out) else s
            for e, s in zip(study.entries, scores, strict=True)
        ]
    return _led_by_special_cases(
        study, admission, weights(study.problem, scores, prior, study.seed)
    )


def _weighed(study: Study, e: Entry) -> Array:
    """Held-out score per unit (u,) in nats that count: what a further effect gains by the precision
    of its own law. By how far the law that it is built on is off, both are off, and what another
    law may follow of that is asked before it is named (:func:`_relieves_enough`).
    """
    there = [x for x in study.entries if x.effects and set(x.effects) < set(e.effects)]
    if not there:
        return tempered(study, e)
    base = max(there, key=lambda x: x.score)
    return _weighed(study, base) + tempered(study, e, base) - tempered(study, base, base)


def _led_by_special_cases(study: Study, admission: Admission, weight: Array) -> Array:
    """Weights (m,) in which no general hypothesis has more than the special case that it does no
    more than; together they weigh what they did.
    """
    at = {e.name: k for k, e in enumerate(study.entries)}
    weight = weight.copy()
    for special in sorted(set(admission.general.values())):
        general = [at[n] for n, s in admission.general.items() if s == special]
        group = [at[special], *general]
        whole = float(weight[group].sum())
        weight[at[special]] = weight[group].max()
        weight[group] *= whole / max(float(weight[group].sum()), TINY)
    return weight
