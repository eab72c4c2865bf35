"""Torque, current or voltage limit of the drive: the loop's demand is clipped at (1 - depth) of the
unlimited peak.
"""

from __future__ import annotations

from pianobot_ros.axis.laws.base import Scales
from pianobot_ros.gap import Effect, Parameter


def effect(s: Scales) -> Effect:
    """Depth of the clipping, a fraction of the peak demand."""
    return Effect(
        "torque_limit",
        "drive",
        [Parameter("torque_limit", 0.0, 0.0, 0.95, "1", sd=0.3)],
        [{"torque_limit": x} for x in (0.1, 0.3, 0.6)],
        description="the drive cannot give what the loop demands",
    )
