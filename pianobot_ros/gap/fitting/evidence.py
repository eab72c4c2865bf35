"""What hypotheses are judged by: blocks and twin together, the floor, the likelihood and the folds;
and the few questions that every step asks of a prediction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from scipy.special import chdtri, ndtri

from pianobot_ros.gap.fitting.fit import Fit, Fitter
from pianobot_ros.gap.floor.measure import Gauge
from pianobot_ros.gap.floor.noise import NoiseModel
from pianobot_ros.gap.problem.options import Options
from pianobot_ros.gap.problem.problem import Index, Problem
from pianobot_ros.gap.problem.types import Array

EVERY = slice(None)


@dataclass(frozen=True)
class Evidence:
    """The problem with its floor. `ways`: two ways of leaving units out, each fold of unit (u,);
    `nominal` prediction (size,); `warnings`: what is to be told of it all.
    """

    problem: Problem
    options: Options
    seed: int
    ways: tuple[Array, ...]
    nominal: Array
    fitter: Fitter
    gauge: Gauge
    warnings: tuple[str, ...] = ()


Some = TypeVar("Some", bound=Evidence)


def told(evidence: Some, *texts: str) -> Some:
    """The evidence with further warnings, each said once."""
    return replace(evidence, warnings=tuple(dict.fromkeys((*evidence.warnings, *texts))))


def judged_by(evidence: Some, noise: NoiseModel, at: Array) -> Some:
    """The evidence under another floor, as efficient as at the prediction `at` (size,)."""
    problem = noise.problem
    fitter, gauge = Fitter(problem, noise, at), Gauge(problem, noise)
    return replace(evidence, problem=problem, fitter=fitter, gauge=gauge)


def pooled(evidence: Evidence, prediction: Array) -> float:
    """Pooled gap of a flat prediction in floors."""
    return evidence.gauge.pooled(evidence.gauge.squares(prediction))


def material(evidence: Evidence, prediction: Array) -> bool:
    """Whether the systematic gap of any observable (or event) exceeds the material share of its
    floor.
    """
    return bool(open_observables(evidence, prediction))


def anything(evidence: Evidence) -> bool:
    """Whether the nominal twin's gap is more than chance makes of a perfect twin's.

    Of several observables one is open by chance more often than each: the error is that of the
    family (Šidák 1967, Journal of the American Statistical Association 62). Logarithms of mean
    squares are compared, whose error does not grow with the gap.
    """
    c, gauge = evidence.options.calibration, evidence.gauge
    each = 1.0 - (1.0 - c.false_alarm) ** (1.0 / max(len(evidence.problem.present), 1))
    squares = gauge.squares(evidence.nominal)
    mean = np.maximum(np.nan_to_num(gauge.per_observable(squares)) ** 2, 1.0)
    chance = -ndtri(each) * gauge.per_observable_error(squares) / mean
    return bool(np.any(np.log(mean) > np.maximum(np.log1p(c.material**2), chance)))


def open_observables(
    evidence: Evidence,
    prediction: Array,
    size: float | Array | None = None,
    sigma: float | None = None,
) -> list[int]:
    """Observables whose systematic gap is above `size` floors (of all or of each (o,); default:
    material) and no accident of blocks, widest first.

    No accident: the squared gap is `sigma` (default: open_sigma) standard errors above the floor's
    square; or more blocks are far off than chance brings, however much these differ.
    """
    c, gauge = evidence.options.calibration, evidence.gauge
    squares = gauge.squares(prediction)
    each = np.nan_to_num(gauge.per_observable(squares), nan=0.0)
    accident = (c.open_sigma if sigma is None else sigma) * gauge.per_observable_error(squares)
    accident[gauge.more_strays_than_chance(squares)] = 0.0
    limit = 1.0 + np.maximum(np.square(c.material if size is None else size), accident)
    return [int(o) for o in np.argsort(-each) if each[o] ** 2 > limit[o]]


def prior_cost(fit: Fit, of: slice | Index = EVERY) -> float:
    """How far (nats) the prior `of` some parameters (default: all) had to be stretched.

    A missing effect is often absorbed by implausible values.
    """
    return 0.5 * float(fit.v[of] @ fit.v[of])


def implausible(evidence: Evidence) -> float:
    """Prior cost (nats) that the parameters of sound cells exceed in `odd` of them: half of a χ²
    with one degree of freedom a parameter.
    """
    count = max(len(evidence.problem.parameters), 1)
    return 0.5 * float(chdtri(count, evidence.options.calibration.odd))
