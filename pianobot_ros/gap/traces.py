"""Pick the traces that show the gap best: for each observable the block of its median-worst gap."""

from __future__ import annotations

import numpy as np

from pianobot_ros.gap.diagnosis import Trace
from pianobot_ros.gap.measure import Gauge
from pianobot_ros.gap.noise import NoiseModel
from pianobot_ros.gap.problem import Problem
from pianobot_ros.gap.types import Array


def traces(
    problem: Problem, gauge: Gauge, noise: NoiseModel, before: Array, after: Array, limit: int = 1500
) -> tuple[Trace, ...]:
    """One trace per series observable, worst observable first, at most `limit` samples each."""
    worst = [r.name for r in gauge.signals(before)]
    chosen: dict[str, Trace] = {}
    for o in problem.present:
        obs = problem.observables[o]
        if obs.kind == "event":
            continue
        cells = [c for c in problem.cells if c.observable == o and problem.mask[c.start : c.stop].any()]
        rms = [
            float(np.sqrt(np.mean((problem.y - before)[c.start : c.stop][problem.mask[c.start : c.stop]] ** 2)))
            for c in cells
        ]
        c = cells[int(np.argsort(rms)[(3 * len(rms)) // 4])]
        step = max(1, (c.stop - c.start) // limit)
        cut = slice(c.start, c.stop, step)
        masked = np.where(problem.mask, 0.0, np.nan)
        block = problem.blocks[c.block]
        chosen[obs.name] = Trace(block.name, block.condition, obs.name, obs.stage, obs.unit, float(noise.floor[o]),
                                 c.t[::step] - c.t[0], problem.y[cut], (before + masked)[cut], (after + masked)[cut])  # fmt: skip
    return tuple(chosen[n] for n in worst if n in chosen)
