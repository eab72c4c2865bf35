"""The key's spring is preloaded against the rest stop: a torque before the key moves at
all (touch weight), constant or less with the key's angle.
"""

from __future__ import annotations

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import StrikeLaw

EFFECT = Effect.of_size(
    Parameter("key_preload", 0.0, 0.0, 0.5, "N*m", "key", sd=0.03),
    (0.004, 0.02, 0.08),
    "the key needs a force before it moves at all",
    further=[Parameter("key_preload_fade", 0.0, 0.0, 500.0, "1/rad", sd=30.0)],
    law=StrikeLaw(),
)
