"""Torque constant that falls as the motor warms: the same motion costs more current late in the
session.
"""

from __future__ import annotations

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter


def effect(s: Scales) -> Effect:
    """Relative change of effort per torque from the first to the last sample (linear in session
    time).
    """
    return Effect.of_size(
        Parameter("torque_droop", 0.0, -0.6, 1.5, "1", "drive", sd=0.2),
        (0.1, 0.4, -0.2),
        "effort per torque drifts over the session",
    )
