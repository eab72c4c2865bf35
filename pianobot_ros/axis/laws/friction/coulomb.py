"""Coulomb friction: a constant resistance against the direction of motion."""

from __future__ import annotations

from pianobot_ros.axis.laws.base import Scales, effect
from pianobot_ros.gap import Effect, Parameter


def build(s: Scales) -> Effect:
    """Level, effort units."""
    e = s.effort
    return effect(
        "coulomb",
        "mechanics",
        [Parameter("coulomb", 0.0, 0.0, 5 * e, s.effort_unit, "mechanics", sd=0.3 * e)],
        [[0.05 * e], [0.2 * e], [0.6 * e]],
        "dry friction",
    )
