"""Note messages of the piano, and their bytes."""

from __future__ import annotations

from dataclasses import dataclass

from pianobot_ros.devices.midi.silence import NOTE_OFF, NOTE_ON

__all__ = ["MidiMessage", "note_message"]


@dataclass(frozen=True)
class MidiMessage:
    """A note message: ``status`` 0x90 or 0x80, ``channel`` 0 to 15, ``note``, ``velocity`` 0 to
    127, ``time_ns`` host time of arrival (0 for one to be sent)."""

    status: int
    channel: int
    note: int
    velocity: int
    time_ns: int = 0

    @property
    def sounds(self) -> bool:
        """Whether it begins a note."""
        return self.status == NOTE_ON and self.velocity > 0

    @property
    def data(self) -> bytes:
        """The message as MIDI has it."""
        return bytes([self.status | self.channel, self.note, self.velocity])


def note_message(data: bytes, time_ns: int) -> MidiMessage | None:
    """A whole MIDI message as a note message, or None if it is none.

    A note-on of velocity 0 is a note-off (MIDI 1.0); many instruments send it.
    """
    if len(data) != 3 or max(data[1:]) > 127:
        return None
    status, channel = data[0] & 0xF0, data[0] & 0x0F
    if status not in (NOTE_ON, NOTE_OFF):
        return None
    if status == NOTE_ON and data[2] == 0:
        status = NOTE_OFF
    return MidiMessage(status, channel, data[1], data[2], time_ns)
