"""Torque, current or voltage limit of the drive: the loop's demand is clipped at (1 - depth) of the
unlimited peak.
"""

from __future__ import annotations

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter


def effect(s: Scales) -> Effect:
    """Depth of the clipping, a fraction of the peak demand."""
    return Effect.of_size(
        Parameter("torque_limit", 0.0, 0.0, 0.95, "1", "drive", sd=0.3),
        (0.1, 0.3, 0.6),
        "the drive cannot give what the loop demands",
    )
