"""What happens at one instant: notes and announced strikes."""

from __future__ import annotations

import math
from typing import Any

from pianobot_ros.cell.messages.stamps import seconds
from pianobot_ros.cell.recordings.keystroke import NoteEvent
from pianobot_ros.cell.recordings.recording import Strike

__all__ = ["NOTE_OFF", "NOTE_ON", "STRIKE_FIELDS", "note_event", "strike"]

STRIKE_WORDS = ("index", "phrase", "condition", "finger", "note")
STRIKE_NUMBERS = ("speed", "depth", "hold", "pressure", "note_length")
STRIKE_FIELDS = (*STRIKE_WORDS, *STRIKE_NUMBERS)
"""What StrikeMark and :class:`~pianobot_ros.cell.recordings.recording.Strike` call alike."""

NOTE_OFF, NOTE_ON = 0x80, 0x90  # upper half of a MIDI status byte; the lower one is the channel


def note_event(message: Any, time: float) -> NoteEvent | None:
    """A MidiEvent as a note event at ``time`` (s on any axis); None for other kinds of message.

    A note-on of velocity 0 is a note-off, as MIDI 1.0 says.
    """
    kind = message.status & 0xF0
    if kind not in (NOTE_OFF, NOTE_ON) or message.note > 127 or message.velocity > 127:
        return None
    on = kind == NOTE_ON and message.velocity > 0
    return NoteEvent(time, on, int(message.note), int(message.velocity))


def strike(message: Any, start: float, epoch: float = 0.0) -> Strike | None:
    """A StrikeMark as a strike from ``start`` on, s since ``epoch`` (s since the Unix epoch); None
    if its window or a number of it makes no sense.
    """
    found = Strike(
        index=int(message.index),
        phrase=str(message.phrase),
        condition=str(message.condition),
        finger=str(message.finger),
        note=int(message.note),
        start=start,
        end=seconds(message.end) - epoch,
        speed=float(message.speed),
        depth=float(message.depth),
        hold=float(message.hold),
        pressure=float(message.pressure),
        note_length=float(message.note_length),
    )
    numbers = (found.speed, found.depth, found.hold, found.pressure, found.note_length)
    sane = found.end > found.start and found.note <= 127 and all(map(math.isfinite, numbers))
    return found if sane else None
