"""First-order lag of the command (a filter in the drive or in the trajectory generator)."""

from __future__ import annotations

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter


def effect(s: Scales) -> Effect:
    """Time constant of the filter, s."""
    return Effect.of_size(
        Parameter("command_lag", 0.0, 0.0, 0.5, "s", "command", sd=0.04),
        (0.008, 0.03, 0.1),
        "the command is low-pass filtered",
    )
