"""Friction that the controller compensates: it pushes in the direction of the commanded motion."""

from __future__ import annotations

from pianobot_ros.axis.laws.base import Scales, effect
from pianobot_ros.gap import Effect, Parameter


def build(s: Scales) -> Effect:
    """Level of the push, effort units."""
    e = s.effort
    return effect(
        "friction_compensation",
        "drive",
        [Parameter("friction_compensation", 0.0, 0.0, 5 * e, s.effort_unit, "drive", sd=0.3 * e)],
        [[0.1 * e], [0.4 * e]],
        "the controller pushes against friction",
    )
