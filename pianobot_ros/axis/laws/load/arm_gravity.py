"""Gravity of an arm: a joint carries its own link and the next ones, which other joints turn."""

from __future__ import annotations

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter


def effect(s: Scales) -> Effect:
    """Sine of the sum with other joints' angles (amplitude, effort; angle, rad), and of the own."""
    e = s.effort
    angles = (-2.36, -0.79, 0.79, 2.36)
    return Effect(
        "arm_gravity",
        "load",
        [
            Parameter("arm_gravity", 0.0, 0.0, 20 * e, s.effort_unit, sd=e),
            Parameter("arm_angle", 0.0, -4.0, 4.0, "rad", sd=2.0),
            Parameter("arm_own", 0.0, 0.0, 20 * e, s.effort_unit, sd=e),
            Parameter("arm_own_angle", 0.0, -4.0, 4.0, "rad", sd=2.0),
        ],
        [
            {"arm_gravity": 0.5 * e, "arm_angle": a, "arm_own": 0.5 * e, "arm_own_angle": b}
            for a in angles
            for b in angles[::2]
        ]
        + [
            {"arm_gravity": 0.7 * e, "arm_angle": a, "arm_own": 0.0, "arm_own_angle": 0.0}
            for a in angles
        ],
        description="gravity that changes with other joints",
        remainder=("gravity", {"gravity": "arm_own", "gravity_angle": "arm_own_angle"}),
    )
