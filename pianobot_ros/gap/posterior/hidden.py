"""Effects that may hide where refitted parameters close the gap.

The data bound such an effect's size but do not exclude it. Its odds against "parameters" are its
prior odds times its linearised held-out gain, times the Occam factor of a Laplace approximation:
the share of its prior that the data leave, with the nuisances free to move along. How much of what
it gains below the floor is believed (`below_floor`) goes by how exact twin and laws are; that
parameters need not be as odd is no matter of the data.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pianobot_ros.gap.diagnosis import Hypothesis
from pianobot_ros.gap.fitting.evidence import prior_cost
from pianobot_ros.gap.fitting.quadratic import unhidden
from pianobot_ros.gap.posterior.verdict import log_priors
from pianobot_ros.gap.problem.constants import TINY
from pianobot_ros.gap.problem.types import Effect, Parameter
from pianobot_ros.gap.search.screening import Screened
from pianobot_ros.gap.search.study import Study, temperatures, tempered


def hidden_odds(study: Study) -> dict[str, float]:
    """Odds of each screened effect against "parameters", by name."""
    effects = study.problem.effects
    c = study.options.calibration
    names = [s.effect for s in study.screened]
    prior = log_priors([(n, (n,)) for n in names], c, len(effects))
    refit, odds = study.entry("parameters"), {}
    fitted = {e.effects[0]: e for e in study.entries if len(e.effects) == 1}
    for s, spread, log_prior in zip(study.screened, _spreads(study), prior, strict=True):
        magnitude, start = _magnitude(effects[s.effect], s)
        left = abs(start) * spread / magnitude.sd
        fits, natural = s.gain - s.natural, s.natural
        if e := fitted.get(s.effect):  # what was fitted needs no line
            fits = float((tempered(study, e) - tempered(study, refit)).sum())
            natural = (prior_cost(refit.fit) - prior_cost(e.fit)) / c.prior_temperature
        gain = max(min(fits, c.below_floor) + natural, 0.0)  # 0: of no size
        odds[s.effect] = c.hidden * float(np.exp(log_prior + gain) * min(left, 1.0))
    return odds


def likelier(study: Study) -> bool:
    """Whether an effect that refitted parameters may hide is likelier than nothing but them."""
    return max(hidden_odds(study).values(), default=0.0) > 1.0


def hiding(study: Study, masses: Mapping[str, float]) -> tuple[Hypothesis, ...]:
    """The effects that may hide, likeliest first, by their probabilities `masses`: each at the root
    mean square of the sizes that the data and its prior leave it, with the parameters that make
    room for its likeliest size.
    """
    gap, found = study.entry("parameters").gap, []
    for s, spread in zip(study.screened, _spreads(study), strict=True):
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
        found.append(Hypothesis((s.effect,), s.effect, p, s.gain, np.nan, gap, values))
    return tuple(sorted(found, key=lambda h: -h.probability))


def _spreads(study: Study) -> list[float]:
    """Standard deviation of each screened effect's size given the data, with the nuisances free to
    move along, in units of the size at which it was screened.
    """
    fit = study.entry("parameters").fit
    if not study.screened:
        return []
    problem, white = study.problem, study.fitter.whitened(fit)
    kappa = study.fitter.likelihood.kappa(white.mean) / temperatures(study)
    root = np.sqrt(kappa[problem.obs_of] * np.where(problem.mask, white.weight, 0.0))
    signatures = np.array([s.signature for s in study.screened]).T
    inner = unhidden(signatures * root[:, None], white.jacobian * root[:, None])
    return [float(1.0 / np.sqrt(max(float(norm), TINY))) for norm in np.diag(inner)]


def _magnitude(effect: Effect, screened: Screened) -> tuple[Parameter, float]:
    """The parameter that is an effect's magnitude, and how far from null it was screened."""
    return effect.size, effect.at(screened.start)[effect.magnitude] - effect.null
