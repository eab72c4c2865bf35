"""Concave viscous friction: it grows ever more slowly with speed (lubricated gears)."""

from __future__ import annotations

import math

from numba import njit

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def law(v: float, level: float, speed: float) -> float:
    """Resistance at speed v, effort units: linear far below `speed`, `level` far above it."""
    return level * math.tanh(v / speed)


def effect(s: Scales) -> Effect:
    """Level at high speed, effort units; and the speed at which it bends."""
    e, v = s.effort, s.speed
    return Effect(
        "concave_viscous",
        "mechanics",
        [
            Parameter("concave_viscous", 0.0, 0.0, 5 * e, s.effort_unit, sd=0.3 * e),
            Parameter("concave_speed", v, 0.2 * v, 5 * v, "rad/s", sd=0.5, log=True),
        ],
        [
            {"concave_viscous": level * e, "concave_speed": bend * v}
            for level, bend in ((0.2, 0.5), (0.5, 1.0), (0.5, 2.0))
        ],
        description="viscous friction that bends down with speed",
        law=law,
    )
