"""Transport delay: the loop obeys the command that was sent `delay` seconds ago."""

from __future__ import annotations

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter


def effect(s: Scales) -> Effect:
    """Delay of the command, s; on a slow bus a few of its intervals are nothing unusual."""
    top = max(0.4, 10 * s.dt)
    usual = max(0.03, 2 * s.dt)
    return Effect.of_size(
        Parameter("command_delay", 0.0, 0.0, top, "s", "command", sd=usual),
        (0.005, 0.02, 0.06, 0.15),
        "the command arrives late",
    )
