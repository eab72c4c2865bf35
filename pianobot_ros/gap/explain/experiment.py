"""The next experiment: which candidate blocks would tell the leading hypotheses apart, and by how
much.

Each hypothesis predicts each proposed block with its own fitted parameters; two of them are
separated by the squared distance of their predictions in units of the floor, after the nuisance
parameters have moved to hide it as well as they can (that is the T-optimality of Atkinson and
Fedorov 1975). What a block is expected to tell is the information that it carries about which of
the hypotheses holds, which is the criterion of Box and Hill (1967), by the lower bound that
Kolchinsky and Tracey (2017) give for a mixture of normal distributions: the distances saturate, so
hypotheses that are surely told apart need not be told apart further, and it never exceeds what is
open.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np

from pianobot_ros.gap.diagnosis import Diagnosis
from pianobot_ros.gap.fitting.quadratic import unhidden
from pianobot_ros.gap.fitting.space import Space
from pianobot_ros.gap.problem.constants import (
    INDEPENDENT,
    LEADERS,
    MISSED,
    NEGLIGIBLE,
    RUN_AWAY,
    SAMPLES,
    SMALL,
    TINY,
)
from pianobot_ros.gap.problem.errors import GapError
from pianobot_ros.gap.problem.recordings.intake import blocks_that
from pianobot_ros.gap.problem.types import Array, Block, Twin


@dataclass(frozen=True)
class Proposal:
    """A proposed block with what one play of it is expected to tell (nats), and the pair of names
    that it tells apart best.

    `weight` (h,) of the hypotheses and `apart` (h, h), their distances in one play, are what more
    plays are reckoned from.
    """

    block: Block
    gain: float
    pair: tuple[str, str]
    per_observable: Mapping[str, float]
    weight: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    apart: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False)

    def to_json(self, typical: float) -> dict[str, Any]:
        """What diagnosis.json's next_experiment holds."""
        return {
            "name": self.block.name,
            "condition": self.block.condition,
            "attributes": dict(self.block.attributes),
            "units": dict(self.block.units),
            "expected_gain": self.gain,
            "unit": "nats per play",
            "separates": list(self.pair),
            "shows_in": max(self.per_observable, key=lambda k: self.per_observable[k], default=""),
            "gain_over_median": self.gain / max(typical, TINY),
        }


def information(weight: Array, apart: Array) -> float:
    """What blocks are expected to tell (nats) about which hypothesis holds: `weight` (h,) adds up
    to 1, `apart` (h, h) are Bhattacharyya distances, added over blocks.
    """
    return float(-weight @ np.log(np.exp(-apart) @ weight)) if weight.size else 0.0


def together(proposals: Sequence[Proposal], plays: int) -> float:
    """What `plays` of each of some proposals are expected to tell together (nats)."""
    if not proposals:
        return 0.0
    apart = np.sum([p.apart for p in proposals], axis=0)
    return information(proposals[0].weight, plays * apart)


def propose_experiment(
    twin: Twin, diagnosis: Diagnosis, candidates: Sequence[Block]
) -> list[Proposal]:
    """Rank `candidates` (blocks with inputs; outputs only carry the time stamps to predict at) by
    what one play is expected to tell.

    Uses the leading hypotheses of the diagnosis with their fitted values, and the first of the
    effects that may hide behind refitted parameters. Returns the proposals, best first.
    """
    if not candidates:
        raise GapError("give at least one candidate experiment to choose from")
    leaders = [h for h in diagnosis.hypotheses if h.values][:LEADERS]
    leaders += diagnosis.hiding[:LEADERS]
    if len(leaders) < 2:
        return []
    floors = {row.name: row.floor_si for row in diagnosis.signals}
    nominal = {p.name: p.nominal for p in twin.parameters}
    space = Space(tuple(twin.parameters))

    def simulate(blocks: Sequence[Block]) -> list[Any]:
        return [twin.simulate(blocks, {**nominal, **h.values}, h.effects) for h in leaders]

    try:
        predictions = simulate(candidates)
    except Exception:  # of one of them, it may be
        candidates, _ = blocks_that(lambda b: simulate([b]), candidates)
        predictions = simulate(candidates)
    base_values = {**nominal, **leaders[0].values}
    shifted = _shifts(twin, candidates, space, base_values, leaders[0].effects)
    weight = np.array([max(h.probability, NEGLIGIBLE) for h in leaders])
    weight = weight / weight.sum()
    out = []
    for b, block in enumerate(candidates):
        moved = [_difference(s[b], predictions[0][b], floors)[0] for s in shifted]
        each = [p[b] for p in predictions]
        apart = np.zeros((len(leaders), len(leaders)))
        most, pair, shows = -1.0, (leaders[0].name, leaders[1].name), dict[str, float]()
        for i, j in combinations(range(len(leaders)), 2):
            d, per = _difference(each[i], each[j], floors)
            jac = np.array(moved).reshape(len(moved), d.size).T
            # a quarter of half the squared distance
            apart[i, j] = apart[j, i] = 0.5 * max(float(unhidden(0.5 * d, jac)), 0.0)
            separated = float(weight[i] * weight[j] * -np.expm1(-apart[i, j]))
            if separated > most:
                most, pair, shows = separated, (leaders[i].name, leaders[j].name), per
        out.append(Proposal(block, information(weight, apart), pair, shows, weight, apart))
    return sorted(out, key=lambda p: -p.gain)


def _shifts(
    twin: Twin,
    blocks: Sequence[Block],
    space: Space,
    values: Mapping[str, float],
    effects: Sequence[str],
) -> list[Any]:
    """Predictions with each nuisance moved by `SMALL` (what is left to hide behind after a fit)."""
    v0 = space.encode(values)
    out = []
    for j in range(len(space)):
        v = v0.copy()
        v[j] += SMALL if v[j] + SMALL <= space.high[j] else -SMALL
        try:
            out.append(twin.simulate(blocks, {**values, **space.decode(v)}, effects))
        except Exception:  # a nuisance that cannot move hides nothing
            continue
    return out


def _difference(
    a: Mapping[str, Any], b: Mapping[str, Any], floors: Mapping[str, float]
) -> tuple[Array, dict[str, float]]:
    parts, per = [], {}
    for name in floors:
        if name not in a or name not in b:
            continue
        one, other = (np.atleast_1d(np.asarray(y[name], float)) for y in (a, b))
        x = np.where(np.isfinite(one - other), one - other, 0.0) / floors[name]
        x[np.isfinite(one) != np.isfinite(other)] = MISSED
        x = np.clip(x[:: max(1, x.size // SAMPLES)], -RUN_AWAY, RUN_AWAY)
        x = x / np.sqrt(max(1.0, x.size / INDEPENDENT))
        per[name] = float(x @ x)
        parts.append(x)
    return (np.concatenate(parts) if parts else np.zeros(1)), per
