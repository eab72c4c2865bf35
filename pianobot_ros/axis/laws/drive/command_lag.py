"""First-order lag of the command (a filter in the drive or in the trajectory generator)."""

from __future__ import annotations

from pianobot_ros.axis.laws.base import Scales
from pianobot_ros.gap import Effect, Parameter


def effect(s: Scales) -> Effect:
    """Time constant of the filter, s."""
    return Effect(
        "command_lag",
        "command",
        [Parameter("command_lag", 0.0, 0.0, 0.5, "s", sd=0.04)],
        [{"command_lag": x} for x in (0.008, 0.03, 0.1)],
        description="the command is low-pass filtered",
    )
