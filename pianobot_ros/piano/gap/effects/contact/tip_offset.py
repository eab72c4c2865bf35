"""The fingertip is not where it should be: lower (it touches earlier and presses deeper) or further
along the key.
"""

from __future__ import annotations

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import StrikeLaw, Values


def _mechanics(v: Values) -> dict[str, float]:
    return {"tip_drop": v["tip_offset"], "tip_reach": v["tip_offset_reach"]}


EFFECT = Effect.of_size(
    Parameter("tip_offset", 0.0, -0.01, 0.01, "m", "contact", sd=1e-3),
    (1e-4, -1e-4, 8e-4, -8e-4),
    "the fingertip sits lower or higher than it should",
    further=[Parameter("tip_offset_reach", 0.0, -0.03, 0.03, "m", sd=3e-3)],
    law=StrikeLaw(_mechanics),
)
