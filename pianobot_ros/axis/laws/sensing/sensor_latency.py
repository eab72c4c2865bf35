"""Latency between the columns of a log: the effort was sampled (or filtered) later than the
position.
"""

from __future__ import annotations

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter


def effect(s: Scales) -> Effect:
    """Time by which effort and velocity lag behind position, s (negative: lead)."""
    return Effect.of_size(
        Parameter("sensor_latency", 0.0, -0.1, 0.2, "s", "sensing", sd=0.015),
        (0.004, 0.015, 0.04, -0.008),
        "columns of the log are shifted in time",
    )
