"""The wrist follows its command late by a pure delay: transport, buffering (Åström and Murray,
*Feedback Systems*, 9.1).
"""

from __future__ import annotations

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import Array, Memory, Values, WristLaw, shifted


def _wrist(v: Values, t: Array, z: Array, force: Array, memory: Memory | None = None) -> Array:
    del force
    return shifted(t, z, v["wrist_delay"], memory)


EFFECT = Effect.of_size(
    Parameter("wrist_delay", 0.0, 0.0, 0.15, "s", "wrist", sd=0.02),
    (0.003, 0.015, 0.05),
    "the wrist follows its command late by a fixed time",
    law=WristLaw(_wrist),
)
