"""MIDI events arrive late by a fixed time (key scanning, 31250 baud, drivers); note-on and note-off
alike.
"""

from __future__ import annotations

from pianobot_ros.gap import Parameter
from pianobot_ros.piano_twin.effects.base import Title, Values, family


def _delay(v: Values) -> float:
    return v["midi_latency"]


FAMILY = family(
    Title("midi_latency", "sensing", "MIDI events arrive late by a fixed time"),
    [Parameter("midi_latency", 0.0, 0.0, 0.2, "s", sd=0.01)],
    [{"midi_latency": x} for x in (0.002, 0.01, 0.05)],
    note_delay=_delay,
)
