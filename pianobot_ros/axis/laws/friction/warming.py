"""Friction that falls as the joint warms up over a session."""

from __future__ import annotations

import math

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter


def law(share: float, time: float, at: float) -> float:
    """Factor on friction at the session time `at` (s): 1 - `share` when warm, after some `time`."""
    return 1.0 - share * (1.0 - math.exp(-at / time)) if time > 0 else 1.0


def effect(s: Scales) -> Effect:
    """Share of the friction that is gone when warm, and the time constant, s."""
    return Effect(
        "warming",
        "mechanics",
        [
            Parameter("warming", 0.0, -0.5, 0.8, "1", sd=0.2),
            Parameter(
                "warming_time",
                0.4 * s.duration,
                0.05 * s.duration,
                5 * s.duration,
                "s",
                sd=0.7,
                log=True,
            ),
        ],
        [
            {"warming": share, "warming_time": time * s.duration}
            for share, time in ((0.2, 0.3), (0.5, 1.0))
        ],
        description="friction falls as the joint warms up",
        law=law,
    )
