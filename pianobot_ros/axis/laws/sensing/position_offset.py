"""Offset of the position sensor against the command's zero."""

from __future__ import annotations

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter


def effect(s: Scales) -> Effect:
    """Offset, rad."""
    e = max(s.error, 1e-5)
    return Effect.of_size(
        Parameter("position_offset", 0.0, -3.2, 3.2, "rad", "sensing", sd=e),
        [x * e for x in (0.3, -0.3, 1.0, -1.0)],
        "the sensor's zero is off",
    )
