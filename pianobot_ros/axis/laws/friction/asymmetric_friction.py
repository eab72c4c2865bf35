"""Friction that differs between the directions."""

from __future__ import annotations

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter


def effect(s: Scales) -> Effect:
    """Half difference (positive: more resistance forwards) and mean level, effort units."""
    e = s.effort
    return Effect(
        "asymmetric_friction",
        "mechanics",
        [
            Parameter("friction_asymmetry", 0.0, -2 * e, 2 * e, s.effort_unit, sd=0.2 * e),
            Parameter("asymmetric_level", 0.0, 0.0, 5 * e, s.effort_unit, sd=0.3 * e),
        ],
        [
            {"friction_asymmetry": half * e, "asymmetric_level": level * e}
            for half, level in ((0.1, 0.2), (-0.1, 0.2), (0.3, 0.4), (-0.3, 0.4))
        ],
        description="friction differs between the directions",
        remainder=("coulomb", {"coulomb": "asymmetric_level"}),
    )
