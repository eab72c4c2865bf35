"""The fingertip slips on the key where it should stick: friction lower by a share, and lower still
while it slides (Stribeck).
"""

from __future__ import annotations

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import StrikeLaw

EFFECT = Effect(
    "tip_slip",
    "contact",
    [
        Parameter("tip_slip", 0.0, -1.0, 1.0, "1", sd=0.4),
        Parameter("tip_slip_weakening", 0.0, 0.0, 3.0, "1", sd=0.3),
        Parameter("tip_slip_speed", 0.005, 5e-4, 0.1, "m/s", sd=1.0, log=True),
    ],
    [{"tip_slip": x} for x in (0.05, 0.15, 0.5, 0.9)]
    + [{"tip_slip": 0.05, "tip_slip_weakening": 0.1}],
    description="the fingertip slips along the key",
    law=StrikeLaw(),
)
