"""Effects that the data cannot tell apart: their signatures coincide once the nuisances may move,
or their scores tie.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pianobot_ros.gap.fitting.fit import Fit, Fitter
from pianobot_ros.gap.fitting.quadratic import unhidden
from pianobot_ros.gap.fitting.score import difference
from pianobot_ros.gap.problem.constants import PARALLEL, TINY
from pianobot_ros.gap.problem.problem import Problem
from pianobot_ros.gap.problem.types import Array
from pianobot_ros.gap.search.screening import Screened

Scores = list[tuple[str, tuple[str, ...], Array, bool]]


def inner_products(
    fitter: Fitter, base: Fit, screened: Sequence[Screened], temperature: Array | None = None
) -> Array:
    """Inner products (m, m) of effect signatures after projecting out the nuisance directions (with
    priors), in nats, divided by `temperature` (o,).
    """
    problem = fitter.problem
    white = fitter.whitened(base)
    kappa = fitter.likelihood.kappa(white.mean)
    if temperature is not None:
        kappa = kappa / temperature
    root = np.sqrt(kappa[problem.obs_of] * np.where(problem.mask, white.weight, 0.0))
    signatures = np.array([s.signature for s in screened]).T
    return unhidden(signatures * root[:, None], white.jacobian * root[:, None])


def cosines(fitter: Fitter, base: Fit, screened: Sequence[Screened]) -> Array:
    """|cos| of the angles (m, m) between effect signatures after projecting out the nuisance
    directions.
    """
    inner = inner_products(fitter, base, screened)
    norm = np.sqrt(np.maximum(np.diag(inner), TINY))
    return np.asarray(np.abs(inner) / np.outer(norm, norm))


def groups(
    problem: Problem,
    fitter: Fitter,
    scores: Scores,
    base: Fit,
    screened: Sequence[Screened],
) -> tuple[tuple[str, ...], ...]:
    """Groups of names that predict the held-out data equally well: within one standard error or
    parallel signatures.

    `scores` are in nats that count (tempered).
    """
    names = [(n, e, s) for n, e, s, ok in scores if ok and len(e) == 1]
    if not names:
        return ()
    names.sort(key=lambda x: -float(x[2].sum()))
    position = {s.effect: i for i, s in enumerate(screened)}
    angle = cosines(fitter, base, screened) if screened else np.zeros((0, 0))
    out: list[tuple[str, ...]] = []
    taken: set[str] = set()
    for i, (name, _, score) in enumerate(names):
        if name in taken:
            continue
        group = [name]
        for other, _, other_score in names[i + 1 :]:
            gain, se = difference(problem, score, other_score)
            tie = gain < max(se, 1.0)
            along = (
                name in position
                and other in position
                and angle[position[name], position[other]] > PARALLEL
            )
            if tie or (along and gain < 2 * max(se, 1.0)):
                group.append(other)
        if len(group) > 1:
            out.append(tuple(group))
            taken |= set(group)
    return tuple(out)
