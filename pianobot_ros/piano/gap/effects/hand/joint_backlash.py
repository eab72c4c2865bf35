"""Play in the finger's joints: a dead zone of the joint spring (Nordin and Gutman 2002)."""

from __future__ import annotations

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import StrikeLaw

EFFECT = Effect.of_size(
    Parameter("joint_backlash", 0.0, 0.0, 0.15, "rad", "hand", sd=0.01),
    (0.002, 0.01, 0.03),
    "play in the finger's joints",
    law=StrikeLaw(),
)
