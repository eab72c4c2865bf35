"""The key's spring is preloaded against the rest stop: a constant torque before the key moves at
all (touch weight).
"""

from __future__ import annotations

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import StrikeLaw

EFFECT = Effect.of_size(
    Parameter("key_preload", 0.0, 0.0, 0.5, "N*m", "key", sd=0.03),
    (0.004, 0.02, 0.08),
    "the key needs a constant force before it moves",
    law=StrikeLaw(),
)
