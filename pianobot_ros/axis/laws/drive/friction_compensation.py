"""Friction that the controller compensates: it pushes in the direction of the commanded motion."""

from __future__ import annotations

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter


def effect(s: Scales) -> Effect:
    """Level of the push, effort units."""
    e = s.effort
    return Effect.of_size(
        Parameter("friction_compensation", 0.0, 0.0, 5 * e, s.effort_unit, "drive", sd=0.3 * e),
        [x * e for x in (0.1, 0.4)],
        "the controller pushes against friction",
    )
