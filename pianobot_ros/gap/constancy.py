"""Whether an effect is the same size everywhere.

A law that is right has one set of values for all blocks. A law that only looks right, because the library lacks the true one,
would have to grow or shrink with the speed, the load, the pressure ...: letting it do so then gains held-out score.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pianobot_ros.gap.judge import temperatures
from pianobot_ros.gap.quadratic import extend
from pianobot_ros.gap.score import held_out, reach
from pianobot_ros.gap.space import Space
from pianobot_ros.gap.study import Entry, Study
from pianobot_ros.gap.types import Array, Parameter

SLOPE = Parameter("change of size over the attribute's spread", 0.0, -5.0, 5.0, sd=0.5)


@dataclass(frozen=True)
class Variation:
    """`gain` in nats that count if the size of `effect` may vary with `attribute`."""

    effect: str
    attribute: str
    gain: float


def variation(study: Study, entry: Entry) -> Variation | None:
    """The attribute with which one of the hypothesis' effects would best vary, linearised; None if there is none to vary with."""
    fit, problem, fitter = entry.fit, study.problem, study.fitter
    attributes = _attributes(study)
    if fit is None or not entry.effects or not attributes:
        return None
    white = fitter.whitened(fit)
    quad = fitter.quadratic(white)
    weight = np.where(problem.mask, white.weight, 0.0)
    space, v = Space((*fit.space.parameters, SLOPE)), np.append(fit.v, 0.0)
    limit = np.append(reach(fit), 2.0)
    temperature = temperatures(study)
    found = []
    for name in entry.effects:
        column = fit.jacobian[:, fit.space.names.index(problem.effects[name].magnitude)]
        for attribute, x in attributes.items():
            signature = fitter.noise.whiten(column * x[problem.block_of])
            wide = extend(quad, white.z, white.jacobian, signature, problem.runs, weight)
            varying = held_out(fitter, wide, space, v, study.ways, limit)[0]
            found.append(Variation(name, attribute, float(((varying - entry.scored.each) / temperature).sum())))
    return max(found, key=lambda f: f.gain)


def _attributes(study: Study) -> dict[str, Array]:
    """Attributes that every block has and that differ between them, standardised (blocks,)."""
    blocks = study.problem.blocks
    shared = set.intersection(*(set(b.attributes) for b in blocks))
    values = {a: np.array([float(b.attributes[a]) for b in blocks]) for a in sorted(shared)}
    return {a: (x - x.mean()) / x.std() for a, x in values.items() if np.all(np.isfinite(x)) and x.std() > 0}
