"""Coulomb friction: a constant resistance against the direction of motion."""

from __future__ import annotations

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter


def effect(s: Scales) -> Effect:
    """Level, effort units."""
    e = s.effort
    return Effect.of_size(
        Parameter("coulomb", 0.0, 0.0, 5 * e, s.effort_unit, "mechanics", sd=0.3 * e),
        [x * e for x in (0.05, 0.2, 0.6)],
        "dry friction",
    )
