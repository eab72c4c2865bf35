"""MIDI events arrive late by a time that varies from event to event (USB frames, scheduling): a
spread, and half of it late.
"""

from __future__ import annotations

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import LatencyLaw

EFFECT = Effect.of_size(
    Parameter("midi_jitter", 0.0, 0.0, 0.1, "s", "sensing", sd=0.005),
    (0.002, 0.006, 0.02),
    "the time stamps of MIDI events scatter",
    further=[Parameter("midi_jitter_delay", 0.0, -0.02, 0.1, "s", sd=0.005)],
    law=LatencyLaw(delay="midi_jitter_delay", jitter="midi_jitter"),
)
