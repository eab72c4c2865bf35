"""What an observable inherits from the sensor whose signal is spliced in before it.

A signal that is measured is right to within its own floor: nobody claims less of it. Behind a
splice the same error is another one: a force that is wrong by a hundredth throws a light key
through half its travel. So the deviation of one floor of the signal, in proportion to it as laws of
sensors are (gain, creep, hysteresis), is passed through the twin, and each sample that is predicted
from the signal has what comes out as a deviation of its own, to first order (GUM, JCGM 100:2008,
5.1.2). It belongs to the recording and to no hypothesis: all are judged by the same floor.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pianobot_ros.gap.floor.noise import NoiseModel
from pianobot_ros.gap.problem.errors import GapError
from pianobot_ros.gap.problem.problem import Problem
from pianobot_ros.gap.problem.types import Array


def passed_on(noise: NoiseModel, values: Mapping[str, float]) -> NoiseModel:
    """The floor with what each sample inherits by these `values` of the twin's parameters."""
    problem = noise.problem
    deviation = inherited(problem, noise.floor, values)
    return NoiseModel(problem, noise.options, noise.estimates, deviation)


def inherited(problem: Problem, floor: Array, values: Mapping[str, float]) -> Array:
    """Standard deviation (size,) that each sample has from what is spliced in before it, in its own
    unit; 0 where nothing is.

    `floor` (o,) of the observables, in their units; `values` of the twin's parameters, without any
    effect. Raises GapError for an observable that names what the twin has not.
    """
    names = [o.name for o in problem.observables]
    out = np.zeros(problem.size)
    ways = {
        (o.spliced, o.gain)
        for k, o in enumerate(problem.observables)
        if o.spliced and o.gain and k in problem.present
    }
    for spliced, gain in sorted(ways):
        if spliced not in names or gain not in values:
            raise GapError(
                f"an observable is spliced behind {spliced!r} with gain {gain!r}: unknown"
            )
        source = problem.mask & (problem.obs_of == names.index(spliced))
        size = float(np.sqrt(np.mean(problem.y[source] ** 2))) if source.any() else 0.0
        if size <= 0.0:
            continue
        share = floor[names.index(spliced)] / size
        requests = [
            ({**values, gain: values[gain] * x}, ())
            for x in (1.0, 1.0 + share, 1.0 / (1.0 + share))
        ]
        base, *moved = problem.predict_many(requests)
        behind = np.array([o.spliced == spliced and o.gain == gain for o in problem.observables])
        own = behind[problem.obs_of] & problem.mask
        changes = [
            m - base
            for m in moved
            if not isinstance(m, Exception) and not isinstance(base, Exception)
        ]
        if changes:
            out[own] = np.sqrt(np.mean(np.square(changes), axis=0))[own]
    return out
