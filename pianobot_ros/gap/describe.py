"""Describe a residual that nobody explains: what does it depend on? (filled by regressions over named features)"""

from __future__ import annotations

import numpy as np

from pianobot_ros.gap.diagnosis import UnknownDescription
from pianobot_ros.gap.measure import Gauge
from pianobot_ros.gap.noise import NoiseModel
from pianobot_ros.gap.problem import Problem
from pianobot_ros.gap.types import Array


def describe(problem: Problem, gauge: Gauge, noise: NoiseModel, prediction: Array) -> UnknownDescription | None:
    """Describe the worst observable's residual under `prediction`."""
    each = gauge.per_observable(gauge.squares(prediction))
    o = int(np.nanargmax(each))
    obs = problem.observables[o]
    text = f"The largest remainder is in {obs.name} ({each[o]:.1f} × floor)."
    return UnknownDescription(obs.name, obs.stage, obs.unit, text, ())
