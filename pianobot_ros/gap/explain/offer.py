"""What a verdict offers to adopt, and what that does to units that it was not fitted to."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pianobot_ros.gap.diagnosis import Fold, Measure, Offer
from pianobot_ros.gap.fitting.evidence import Evidence
from pianobot_ros.gap.floor.measure import drawn_together
from pianobot_ros.gap.problem.constants import DRAWS
from pianobot_ros.gap.problem.problem import Index
from pianobot_ros.gap.search.study import Entry

__all__ = ["change", "offer"]


def offer(evidence: Evidence, entry: Entry) -> Offer:
    """What adopting ``entry``, whose folds were simulated, would do; nothing for a hypothesis
    without parameters.
    """
    if entry.fit is None:
        return Offer()
    problem, gauge, space = evidence.problem, evidence.gauge, entry.fit.space
    names = np.array([b.name for b in problem.blocks])
    folds = []
    for k, v in enumerate(entry.scored.fold_v):
        held_out = np.unique(problem.block_of_unit[evidence.ways[0] == k])
        values = space.decode(space.clip(v))
        folds.append(Fold(tuple(str(n) for n in names[held_out]), values))
    before, after = gauge.squares(evidence.nominal), gauge.squares(entry.held_out)

    def both(units: Index | None) -> tuple[float, float]:
        return gauge.pooled(before, units), gauge.pooled(after, units)

    blocks = problem.block_of_unit
    gap = change(both, drawn_together(problem.condition_of_block[blocks], blocks), evidence.seed)
    return Offer(entry.effects, tuple(folds), {"gap": gap})


def change(both: Callable[[Index | None], tuple[float, float]], group: Index, seed: int) -> Measure:
    """The measure ``both``, which gives it before and after for indices (None: all), with the
    interval of its change by a bootstrap over the groups of the indices (n,).
    """
    random = np.random.default_rng([seed, 0x0FFE])
    groups = [np.flatnonzero(group == k) for k in range(int(group.max()) + 1)]
    drawn = []
    for _ in range(DRAWS):
        chosen = random.integers(0, len(groups), len(groups))
        before, after = both(np.concatenate([groups[i] for i in chosen]))
        drawn.append(after - before)
    low, high = np.nanpercentile(drawn, [2.5, 97.5])
    return Measure(*both(None), float(low), float(high))
