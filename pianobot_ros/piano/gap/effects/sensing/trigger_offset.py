"""The key's contacts switch at another depth: both trigger angles are shifted, the lower one
possibly otherwise.
"""

from __future__ import annotations

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import TriggerLaw, Values


def _triggers(v: Values) -> tuple[float, float]:
    return v["trigger_offset"], v["trigger_offset"] + v["trigger_offset_off"]


EFFECT = Effect.of_size(
    Parameter("trigger_offset", 0.0, -0.025, 0.011, "rad", "sensing", sd=0.003),
    (6e-4, -6e-4, 4e-3, -4e-3),
    "note-on and note-off happen at another depth of the key",
    further=[Parameter("trigger_offset_off", 0.0, -0.015, 0.015, "rad", sd=0.002)],
    law=TriggerLaw(_triggers),
)
