"""The wrist follows sluggishly: an additional first-order lag, so that fast motion is damped and
slow motion is only late.
"""

from __future__ import annotations

import numpy as np

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import Array, Memory, Values, WristLaw, recall
from pianobot_ros.piano.gap.effects.filters import lag


def _wrist(v: Values, t: Array, z: Array, force: Array, memory: Memory | None = None) -> Array:
    del force
    if v["wrist_lag"] <= 0:
        return z
    return np.asarray(lag(t, z, v["wrist_lag"], recall(memory)))


EFFECT = Effect.of_size(
    Parameter("wrist_lag", 0.0, 0.0, 0.15, "s", "wrist", sd=0.02),
    (0.003, 0.015, 0.05),
    "the wrist follows its command through an additional lag",
    law=WristLaw(_wrist),
)
