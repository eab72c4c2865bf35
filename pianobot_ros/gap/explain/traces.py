"""The traces that a report draws: each observable in every block."""

from __future__ import annotations

import numpy as np

from pianobot_ros.gap.diagnosis import Trace
from pianobot_ros.gap.explain.breakdown import signals
from pianobot_ros.gap.floor.measure import Gauge
from pianobot_ros.gap.floor.noise import NoiseModel
from pianobot_ros.gap.problem.problem import Problem
from pianobot_ros.gap.problem.types import Array

LIMIT = 240_000  # samples of all traces together, so that a report stays a few megabytes
FINE, COARSE = 1500, 60  # most samples of a typical trace; least that any other is thinned to


def traces(
    problem: Problem, gauge: Gauge, noise: NoiseModel, predictions: tuple[Array, Array, Array]
) -> tuple[Trace, ...]:
    """Traces of all series observables, worst observable first, and of each the typical block
    first. ``predictions`` of the twin: before, refitted, after.
    """
    before = predictions[0]
    of_observable = {
        problem.observables[o].name: [
            c for c in problem.cells if c.observable == o and problem.mask[c.start : c.stop].any()
        ]
        for o in problem.present
        if problem.observables[o].kind != "event"
    }
    count = sum(map(len, of_observable.values()))
    share = max(COARSE, LIMIT // max(count, 1))
    masked = np.where(problem.mask, 0.0, np.nan)
    found = []
    for name in [r.name for r in signals(gauge, before) if r.name in of_observable]:
        cells = of_observable[name]
        rms = [
            float(np.sqrt(np.mean((problem.y - before)[c.start : c.stop][use] ** 2)))
            for c in cells
            if (use := problem.mask[c.start : c.stop]).any()
        ]
        typical = cells[int(np.argsort(rms)[(3 * len(rms)) // 4])]
        for c in (typical, *(c for c in cells if c is not typical)):
            limit = max(FINE if c is typical else 0, min(share, FINE))
            cut = slice(c.start, c.stop, max(1, -(-(c.stop - c.start) // limit)))
            obs, block = problem.observables[c.observable], problem.blocks[c.block]
            first, refit, after = ((prediction + masked)[cut] for prediction in predictions)
            found.append(
                Trace(
                    block.name,
                    block.condition,
                    obs.name,
                    obs.stage,
                    obs.unit,
                    float(noise.floor[c.observable]),
                    c.t[:: cut.step] - c.t[0],
                    problem.y[cut],
                    first,
                    refit,
                    after,
                    c is typical,
                )
            )
    return tuple(found)
