"""Torque, current or voltage limit of the drive: the loop's demand is clipped at (1 - depth) of the
unlimited peak. Some loops stop integrating while they are clipped, others wind up (Åström and
Hägglund 2006, *Advanced PID control*, 3.5).
"""

from __future__ import annotations

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter


def effect(s: Scales) -> Effect:
    """Depth of the clipping, a fraction of the peak demand, and the share of the error that is
    still integrated meanwhile.
    """
    return Effect(
        "torque_limit",
        "drive",
        [
            Parameter("torque_limit", 0.0, 0.0, 0.95, "1", "drive", sd=0.3),
            Parameter("torque_limit_windup", 0.5, 0.0, 1.0, "1", sd=0.5),
        ],
        [
            {"torque_limit": depth, "torque_limit_windup": windup}
            for windup in (0.0, 1.0)
            for depth in (0.1, 0.3, 0.6)
        ],
        description="the drive cannot give what the loop demands",
    )
