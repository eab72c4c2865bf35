"""What a verdict offers to adopt, and what that does to units that it was not fitted to."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pianobot_ros.gap.diagnosis import Fold, Measure, Offer
from pianobot_ros.gap.fitting.evidence import Evidence
from pianobot_ros.gap.floor.measure import Gauge, as_drawn, interval
from pianobot_ros.gap.problem.problem import Index
from pianobot_ros.gap.problem.types import Array
from pianobot_ros.gap.search.study import Entry


def offer(evidence: Evidence, entry: Entry) -> Offer:
    """What adopting ``entry``, whose folds were simulated, would do; nothing for a hypothesis
    without parameters.
    """
    if entry.name == "none":
        return Offer()
    problem, gauge, space = evidence.problem, evidence.gauge, entry.fit.space
    names = np.array([b.name for b in problem.blocks])
    folds = []
    for k, v in enumerate(entry.scored.fold_v):
        held_out = np.unique(problem.block_of_unit[evidence.ways[0] == k])
        values = space.decode(space.clip(v))
        folds.append(Fold(tuple(str(n) for n in names[held_out]), values))
    gap = change_of_gap(gauge, evidence.nominal, entry.held_out, evidence.seed)
    return Offer(entry.effects, tuple(folds), {"gap": gap})


def change_of_gap(gauge: Gauge, before: Array, after: Array, seed: int) -> Measure:
    """The pooled gap of two flat predictions (size,)."""
    first, second = gauge.squares(before), gauge.squares(after)
    return change(
        lambda times: (gauge.pooled_each(first, times), gauge.pooled_each(second, times)),
        gauge.together,
        seed,
    )


def change(both: Callable[[Array], tuple[Array, Array]], group: Index, seed: int) -> Measure:
    """The measure ``both``, which gives it before and after (d,) where each thing is there so many
    times (d, n), with the interval of its change by a bootstrap over the groups of the things (n,).
    """
    before, after = both(as_drawn(group, np.random.default_rng(seed)))
    return Measure(float(before[0]), float(after[0]), *interval((after - before)[1:]))
