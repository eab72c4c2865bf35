"""MIDI events arrive late by a time that varies from event to event (USB frames, scheduling): a
spread, and half of it late.
"""

from __future__ import annotations

from pianobot_ros.gap import Parameter
from pianobot_ros.piano_twin.effects.base import Title, family

FAMILY = family(
    Title("midi_jitter", "sensing", "the time stamps of MIDI events scatter"),
    [
        Parameter("midi_jitter", 0.0, 0.0, 0.1, "s", sd=0.005),
        Parameter("midi_jitter_delay", 0.0, -0.02, 0.1, "s", sd=0.005),
    ],
    [{"midi_jitter": x} for x in (0.002, 0.006, 0.02)],
    jitter=lambda v: v["midi_jitter"],
    note_delay=lambda v: v["midi_jitter_delay"],
)
