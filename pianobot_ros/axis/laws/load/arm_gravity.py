"""Gravity of an arm: a joint carries its own link and the next ones, which other joints turn."""

from __future__ import annotations

from pianobot_ros.axis.laws.base import Scales, effect
from pianobot_ros.gap import Effect, Parameter


def build(s: Scales) -> Effect:
    """Sine of the sum with other joints' angles (amplitude, effort; angle, rad), and of the own."""
    e = s.effort
    angles = (-2.36, -0.79, 0.79, 2.36)
    return effect(
        "arm_gravity",
        "load",
        [
            Parameter("arm_gravity", 0.0, 0.0, 20 * e, s.effort_unit, "load", sd=e),
            Parameter("arm_angle", 0.0, -4.0, 4.0, "rad", "load", sd=2.0),
            Parameter("arm_own", 0.0, 0.0, 20 * e, s.effort_unit, "load", sd=e),
            Parameter("arm_own_angle", 0.0, -4.0, 4.0, "rad", "load", sd=2.0),
        ],
        [[0.5 * e, a, 0.5 * e, b] for a in angles for b in angles[::2]]
        + [[0.7 * e, a, 0.0, 0.0] for a in angles],
        "gravity that changes with other joints",
    )
