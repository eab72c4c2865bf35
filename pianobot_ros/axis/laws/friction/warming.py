"""Friction that falls as the joint warms up over a session."""

from __future__ import annotations

import math

from pianobot_ros.axis.laws.base import Scales, effect
from pianobot_ros.gap import Effect, Parameter


def law(share: float, time: float, at: float) -> float:
    """Factor on friction at the session time `at` (s): 1 - `share` when warm, after some `time`."""
    return 1.0 - share * (1.0 - math.exp(-at / time)) if time > 0 else 1.0


def build(s: Scales) -> Effect:
    """Share of the friction that is gone when warm, and the time constant, s."""
    return effect(
        "warming",
        "mechanics",
        [
            Parameter("warming", 0.0, -0.5, 0.8, "1", "mechanics", sd=0.2),
            Parameter(
                "warming_time",
                0.4 * s.duration,
                0.05 * s.duration,
                5 * s.duration,
                "s",
                "mechanics",
                sd=0.7,
                log=True,
            ),
        ],
        [[0.2, 0.3 * s.duration], [0.5, s.duration]],
        "friction falls as the joint warms up",
    )
