"""MIDI events arrive late by a fixed time (key scanning, 31250 baud, drivers); note-on and note-off
alike.
"""

from __future__ import annotations

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import LatencyLaw

EFFECT = Effect.of_size(
    Parameter("midi_latency", 0.0, 0.0, 0.2, "s", "sensing", sd=0.01),
    (0.002, 0.01, 0.05),
    "MIDI events arrive late by a fixed time",
    law=LatencyLaw(delay="midi_latency"),
)
