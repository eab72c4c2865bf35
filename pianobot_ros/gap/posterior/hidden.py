"""Effects that may hide where refitted parameters close the gap, or beside an effect that closes
it.

The data bound such an effect's size but do not exclude it. Its odds against what closes the gap
without it are its prior odds times its linearised held-out gain, times the Occam factor of a
Laplace approximation: the share of its prior that the data leave, with the nuisances free to move
along. How much of what it gains below the floor is believed (`below_floor`) goes by how exact twin
and laws are; that parameters need not be as odd is no matter of the data.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pianobot_ros.gap.diagnosis import Hypothesis
from pianobot_ros.gap.fitting.evidence import prior_cost
from pianobot_ros.gap.fitting.fit import Fit
from pianobot_ros.gap.fitting.quadratic import unhidden
from pianobot_ros.gap.posterior.verdict import log_priors
from pianobot_ros.gap.problem.constants import TINY
from pianobot_ros.gap.problem.types import Effect, Parameter
from pianobot_ros.gap.search.screening import Screened
from pianobot_ros.gap.search.study import Entry, Study, temperatures, tempered


def hidden_odds(study: Study, base: Entry, found: Sequence[Screened]) -> dict[str, float]:
    """Odds of each of the effects `found` on top of `base` against `base` alone, by name."""
    library, c = study.problem.effects, study.options.calibration
    pairs = {s.effect: (*base.effects, s.effect) for s in found}
    there = {frozenset(e.effects): e for e in study.entries if e.effects}
    own, *prior = log_priors([(base.name, base.effects), *pairs.items()], c, len(library))
    odds = {}
    for s, spread, log_prior in zip(found, _spreads(study, base.fit, found), prior, strict=True):
        magnitude, start = _magnitude(library[s.effect], s)
        left = abs(start) * spread / magnitude.sd
        fits, natural = s.gain - s.natural, s.natural
        if e := there.get(frozenset(pairs[s.effect])):  # what was fitted needs no line
            fits = float((tempered(study, e) - tempered(study, base)).sum())
            natural = (prior_cost(base.fit) - prior_cost(e.fit)) / c.prior_temperature
        gain = max(min(fits, c.below_floor) + natural, 0.0)  # 0: of no size
        odds[s.effect] = c.hidden * float(np.exp(log_prior - own + gain) * min(left, 1.0))
    return odds


def likelier(study: Study, base: Entry, found: Sequence[Screened]) -> list[Screened]:
    """Those of the effects `found` on top of `base` that are likelier to be at work than not."""
    odds = hidden_odds(study, base, found)
    return [s for s in found if odds[s.effect] > 1.0]


def hiding(study: Study, masses: Mapping[str, float]) -> tuple[Hypothesis, ...]:
    """The effects that may hide, likeliest first, by their probabilities `masses`: each at the root
    mean square of the sizes that the data and its prior leave it, with the parameters that make
    room for its likeliest size.
    """
    refit, found = study.entry("parameters"), []
    spreads = _spreads(study, refit.fit, study.screened)
    for s, spread in zip(study.screened, spreads, strict=True):
        p = masses[s.effect]
        if p < study.options.calibration.certain:
            continue
        magnitude, start = _magnitude(study.problem.effects[s.effect], s)
        space = study.fitter.space((s.effect,))
        values = dict(space.decode(space.clip(s.v)))
        null = study.problem.effects[s.effect].null
        size = np.hypot(values[magnitude.name] - null, start * spread)
        size = np.copysign(min(float(size), max(magnitude.sd, abs(start))), start)
        values[magnitude.name] = float(np.clip(null + size, magnitude.low, magnitude.high))
        found.append(Hypothesis((s.effect,), s.effect, p, s.gain, np.nan, refit.gap, values))
    return tuple(sorted(found, key=lambda h: -h.probability))


def _spreads(study: Study, fit: Fit, screened: Sequence[Screened]) -> list[float]:
    """Standard deviation of the size of each effect `screened` on top of a fit given the data, with
    the nuisances free to move along, in units of the size at which it was screened.
    """
    if not screened:
        return []
    problem, white = study.problem, study.fitter.whitened(fit)
    kappa = study.fitter.likelihood.kappa(white.mean) / temperatures(study)
    root = np.sqrt(kappa[problem.obs_of] * np.where(problem.mask, white.weight, 0.0))
    signatures = np.array([s.signature for s in screened]).T
    inner = unhidden(signatures * root[:, None], white.jacobian * root[:, None])
    return [float(1.0 / np.sqrt(max(float(norm), TINY))) for norm in np.diag(inner)]


def _magnitude(effect: Effect, screened: Screened) -> tuple[Parameter, float]:
    """The parameter that is an effect's magnitude, and how far from null it was screened."""
    return effect.size, effect.at(screened.start)[effect.magnitude] - effect.null
