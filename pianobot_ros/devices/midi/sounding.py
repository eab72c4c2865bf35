"""The notes that this process lets sound, so that none of them is left hanging."""

from __future__ import annotations

import time

from pianobot_ros.devices.midi.guard import Guard
from pianobot_ros.devices.midi.silence import note_off
from pianobot_ros.devices.midi.transport.ports import Transport

__all__ = ["Sounding"]

Key = tuple[int, int]  # channel, note


class Sounding:
    """Which notes sound, since when; the guard process knows them too.

    Not for several threads at once: the driver holds its lock around each call.
    """

    def __init__(self) -> None:
        self.guard: Guard | None = None
        self._since: dict[Key, float] = {}

    @property
    def keys(self) -> frozenset[Key]:
        """Channel and note of each."""
        return frozenset(self._since)

    def forget(self) -> None:
        """Nothing sounds: the piano has just been silenced."""
        self._since.clear()

    def begin(self, key: Key) -> None:
        """Call before the note-on goes out: a kill in between leaves nothing hanging."""
        self._since[key] = time.monotonic()
        if self.guard is not None:
            self.guard.hold(*key)

    def end(self, key: Key) -> None:
        """Call once the note-off has gone out."""
        self._since.pop(key, None)
        if self.guard is not None:
            self.guard.release(*key)

    def release(self, transport: Transport | None, longer_than: float = float("-inf")) -> int:
        """End the notes that have sounded for longer than this (s); returns how many."""
        now = time.monotonic()
        old = [key for key, since in self._since.items() if now - since > longer_than]
        for key in old:
            if transport is not None:
                transport.send(note_off(*key))
            self.end(key)
        return len(old)
