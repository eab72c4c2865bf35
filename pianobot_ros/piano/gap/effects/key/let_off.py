"""Let-off: extra resistance where the jack meets its button, felt on the way down (Fletcher and
Rossing, 12.1).
"""

from __future__ import annotations

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import StrikeLaw

EFFECT = Effect(
    "let_off",
    "key",
    [
        Parameter("let_off", 0.0, 0.0, 1.0, "N*m", sd=0.05),
        Parameter("let_off_angle", 0.032, 0.02, 0.046, "rad", sd=0.006),
        Parameter("let_off_width", 0.0025, 0.0008, 0.012, "rad", sd=0.5, log=True),
        # torque on the way back over that on the way down: how much of it is dry friction
        Parameter("let_off_return", 0.33, -1.0, 1.0, "1", sd=0.4),
    ],
    [{"let_off": x} for x in (0.03, 0.15)]
    + [{"let_off": 0.05, "let_off_angle": a} for a in (0.024, 0.038)]
    + [{"let_off": 0.05, "let_off_return": -0.8}],
    description="extra resistance at one depth of the key, mostly on the way down",
    law=StrikeLaw(),
)
