"""Offset of the position sensor against the command's zero."""

from __future__ import annotations

from pianobot_ros.axis.laws.base import Scales, effect
from pianobot_ros.gap import Effect, Parameter


def build(s: Scales) -> Effect:
    """Offset, rad."""
    e = max(s.error, 1e-5)
    return effect(
        "position_offset",
        "sensing",
        [Parameter("position_offset", 0.0, -3.2, 3.2, "rad", "sensing", sd=e)],
        [[0.3 * e], [-0.3 * e], [e], [-e]],
        "the sensor's zero is off",
    )
