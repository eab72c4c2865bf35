"""Effects that may hide where refitted parameters close the gap.

The data bound such an effect's size but do not exclude it. Its odds against "parameters" are its
prior odds times its linearised held-out gain, times the Occam factor of a Laplace approximation:
the share of its prior that the data leave, with the nuisances free to move along.
"""

from __future__ import annotations

import numpy as np

from pianobot_ros.gap.posterior.judge import temperatures
from pianobot_ros.gap.posterior.separability import inner_products
from pianobot_ros.gap.posterior.verdict import log_priors
from pianobot_ros.gap.search.study import Study

MOST = 2.0
"""Largest gain (nats that count) that is believed of an effect whose gap refitting closes as well.
"""


def hidden_odds(study: Study) -> dict[str, float]:
    """Odds of each screened effect against "parameters", by name."""
    fit = study.entry("parameters").fit
    if fit is None or not study.screened:
        return {}
    effects = study.problem.effects
    c = study.options.calibration
    names = [s.effect for s in study.screened]
    inner = inner_products(study.fitter, fit, study.screened, temperatures(study))
    prior = log_priors([(n, (n,)) for n in names], c, dict(study.options.prior), len(effects))
    odds = {}
    for s, norm, log_prior in zip(study.screened, np.diag(inner), prior, strict=True):
        (magnitude,) = (
            p for p in effects[s.effect].parameters if p.name == effects[s.effect].magnitude
        )
        start = abs(float(s.start.get(magnitude.name, magnitude.nominal)) - effects[s.effect].null)
        left = start / np.sqrt(max(float(norm), 1e-12)) / magnitude.sd
        gain = np.clip(s.gain / c.temperature, 0.0, MOST)
        odds[s.effect] = c.hidden * float(np.exp(log_prior + gain) * min(left, 1.0))
    return odds
