"""Torque that repeats with position: cogging, gear teeth, an eccentric wheel."""

from __future__ import annotations

import math

from numba import njit

from pianobot_ros.axis.laws.base import Scales, effect
from pianobot_ros.gap import Effect, Parameter


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def law(q: float, amplitude: float, waves: float, phase: float) -> float:
    """Torque at angle q, effort units."""
    return amplitude * math.sin(waves * q + phase) if amplitude != 0.0 else 0.0


def build(s: Scales) -> Effect:
    """Amplitude, periods per radian, phase; starts sit where the residual's spatial spectrum
    peaks.
    """
    e = s.effort
    starts = [[0.1 * e, w, p] for w in s.waves for p in (0.0, 1.57, 3.14, -1.57)]
    return effect(
        "cogging",
        "mechanics",
        [
            Parameter("cogging", 0.0, 0.0, 3 * e, s.effort_unit, "mechanics", sd=0.2 * e),
            Parameter(
                "cogging_waves", s.waves[0], 2.0, 2000.0, "1/rad", "mechanics", sd=1.0, log=True
            ),
            Parameter("cogging_phase", 0.0, -7.0, 7.0, "rad", "mechanics", sd=3.0),
        ],
        starts,
        "torque that repeats with position",
    )
