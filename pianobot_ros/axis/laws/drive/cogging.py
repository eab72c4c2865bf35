"""Torque that repeats with position: cogging, gear teeth, an eccentric wheel."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pianobot_ros.axis.laws.scales import PHASE, Scales
from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.gap.problem.types import Array


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def law(q: float, amplitude: float, waves: float, phase: float) -> float:
    """Torque at angle q, effort units."""
    return amplitude * math.sin(waves * q + phase) if amplitude != 0.0 else 0.0


def along(q: Array, amplitude: float, waves: float, phase: float) -> Array:
    """Torque (n,) along angles q (n,)."""
    return amplitude * np.sin(waves * q + phase)


def effect(s: Scales) -> Effect:
    """Amplitude, periods per radian, phase; starts sit where the residual's spatial spectrum
    peaks. What does not come back within the travel is not known to repeat: any weight would do;
    nor is what a joint passes at a speed at which the signals do not hold it.
    """
    e = s.effort
    low = min(max(2.0, 2.0 * math.pi / s.travel), 1000.0)
    high = max(s.finest, 2.0 * low, *s.waves)
    return Effect(
        "cogging",
        "mechanics",
        [
            Parameter("cogging", 0.0, 0.0, 3 * e, s.effort_unit, sd=0.2 * e),
            Parameter("cogging_waves", max(s.waves[0], low), low, high, "1/rad", sd=1.0, log=True),
            Parameter("cogging_phase", 0.0, -PHASE, PHASE, "rad", sd=3.0),
        ],
        [
            {"cogging": 0.1 * e, "cogging_waves": waves, "cogging_phase": phase}
            for waves in s.waves
            for phase in (0.0, 1.57, 3.14, -1.57)
        ],
        description="torque that repeats with position",
        law=law,
    )
