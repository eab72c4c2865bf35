"""Two clocks: the command's time stamps run faster or slower than the measurements'."""

from __future__ import annotations

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter


def effect(s: Scales) -> Effect:
    """Lag of the measurement gained over the whole session, s (starting from 0)."""
    return Effect.of_size(
        Parameter("clock_skew", 0.0, -1.0, 1.0, "s", "clock", sd=0.04),
        (0.01, 0.05, -0.01, -0.05),
        "command and measurement clocks drift apart",
    )
