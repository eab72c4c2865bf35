"""Stribeck friction: dry friction that is higher at low speed and falls off with it."""

from __future__ import annotations

import math

from numba import njit

from pianobot_ros.axis.laws.base import Scales, effect
from pianobot_ros.gap import Effect, Parameter


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def law(v: float, rise: float, base: float, speed: float) -> float:
    """Dry resistance at speed v, effort units."""
    return base + rise * math.exp(-((v / speed) ** 2)) if speed > 0 else base


def build(s: Scales) -> Effect:
    """Rise at standstill above the level at speed; and the speed at which it is gone, well below
    those of the log: a rise that is never gone is Coulomb friction.
    """
    e, v = s.effort, s.speed
    return effect(
        "stribeck",
        "mechanics",
        [
            Parameter("stribeck_rise", 0.0, 0.0, 5 * e, s.effort_unit, "mechanics", sd=0.3 * e),
            Parameter("stribeck_level", 0.0, 0.0, 5 * e, s.effort_unit, "mechanics", sd=0.3 * e),
            Parameter(
                "stribeck_speed", 0.2 * v, 0.01 * v, 0.7 * v, "rad/s", "mechanics", sd=0.7, log=True
            ),
        ],
        [[0.1 * e, 0.1 * e, 0.3 * v], [0.3 * e, 0.2 * e, 0.15 * v], [0.3 * e, 0.1 * e, 0.5 * v]],
        "dry friction that falls with speed",
    )
