"""Messages that end notes."""

from __future__ import annotations

__all__ = ["ACTIVE_SENSING", "NOTE_OFF", "NOTE_ON", "note_off", "silence_messages"]

NOTE_OFF, NOTE_ON = 0x80, 0x90
ACTIVE_SENSING = b"\xfe"

_ALL_NOTES_OFF = 123  # controller number; not every piano obeys it
_RELEASE_VELOCITY = 64  # MIDI 1.0: for senders that do not measure it


def note_off(channel: int, note: int) -> bytes:
    """A note-off."""
    return bytes([NOTE_OFF | channel, note, _RELEASE_VELOCITY])


def silence_messages(channel: int) -> list[bytes]:
    """What ends every note of a channel: "all notes off", and a note-off for each of a piano's 88
    keys.
    """
    return [
        bytes([0xB0 | channel, _ALL_NOTES_OFF, 0]),
        *(note_off(channel, note) for note in range(21, 109)),
    ]
