"""MIDI events arrive late by a time that varies from event to event (USB frames, scheduling): a spread, and half of it late."""

from __future__ import annotations

from pianobot_ros.cell_gap.effects.base import Values, family
from pianobot_ros.gap import Parameter


def _jitter(v: Values) -> float:
    return v["midi_jitter"]


def _delay(v: Values) -> float:
    return v["midi_jitter_delay"]


FAMILY = family(
    "midi_jitter", "sensing", "the time stamps of MIDI events scatter",
    [Parameter("midi_jitter", 0.0, 0.0, 0.1, "s", sd=0.005),
     Parameter("midi_jitter_delay", 0.0, -0.02, 0.1, "s", sd=0.005)],
    [{"midi_jitter": x} for x in (0.002, 0.006, 0.02)], jitter=_jitter, note_delay=_delay,
)  # fmt: skip
