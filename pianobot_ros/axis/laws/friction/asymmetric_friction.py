"""Friction that differs between the directions."""

from __future__ import annotations

from pianobot_ros.axis.laws.base import Scales, effect
from pianobot_ros.gap import Effect, Parameter


def build(s: Scales) -> Effect:
    """Half difference (positive: more resistance forwards) and mean level, effort units."""
    e = s.effort
    return effect(
        "asymmetric_friction",
        "mechanics",
        [
            Parameter(
                "friction_asymmetry", 0.0, -2 * e, 2 * e, s.effort_unit, "mechanics", sd=0.2 * e
            ),
            Parameter("asymmetric_level", 0.0, 0.0, 5 * e, s.effort_unit, "mechanics", sd=0.3 * e),
        ],
        [[0.1 * e, 0.2 * e], [-0.1 * e, 0.2 * e], [0.3 * e, 0.4 * e], [-0.3 * e, 0.4 * e]],
        "friction differs between the directions",
    )
