"""Stribeck friction: dry friction that is higher at low speed and falls off with it."""

from __future__ import annotations

import math

from numba import njit

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def law(v: float, rise: float, base: float, speed: float) -> float:
    """Dry resistance at speed v, effort units."""
    return base + rise * math.exp(-((v / speed) ** 2)) if speed > 0 else base


def effect(s: Scales) -> Effect:
    """Rise at standstill above the level at speed; and the speed at which it is gone, well below
    those of the log: a rise that is never gone is Coulomb friction.
    """
    e, v = s.effort, s.speed
    return Effect(
        "stribeck",
        "mechanics",
        [
            Parameter("stribeck_rise", 0.0, 0.0, 5 * e, s.effort_unit, sd=0.3 * e),
            Parameter("stribeck_level", 0.0, 0.0, 5 * e, s.effort_unit, sd=0.3 * e),
            Parameter("stribeck_speed", 0.2 * v, 0.01 * v, 0.7 * v, "rad/s", sd=0.7, log=True),
        ],
        [
            {"stribeck_rise": rise * e, "stribeck_level": level * e, "stribeck_speed": gone * v}
            for rise, level, gone in ((0.1, 0.1, 0.3), (0.3, 0.2, 0.15), (0.3, 0.1, 0.5))
        ],
        description="dry friction that falls with speed",
        law=law,
        remainder=("coulomb", {"coulomb": "stribeck_level"}),
    )
