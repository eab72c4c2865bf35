"""The wrist follows its command late by a pure delay: transport, buffering (Åström and Murray,
*Feedback Systems*, 9.1).
"""

from __future__ import annotations

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano_twin.effects.base import Array, Memory, Values, WristLaw, shifted


def _wrist(v: Values, t: Array, z: Array, force: Array, memory: Memory | None = None) -> Array:
    del force
    return shifted(t, z, v["wrist_delay"], memory)


EFFECT = Effect(
    "wrist_delay",
    "wrist",
    [Parameter("wrist_delay", 0.0, 0.0, 0.15, "s", sd=0.02)],
    [{"wrist_delay": x} for x in (0.003, 0.015, 0.05)],
    description="the wrist follows its command late by a fixed time",
    law=WristLaw(_wrist),
)
