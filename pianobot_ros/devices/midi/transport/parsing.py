"""MIDI bytes into messages, within bounds."""

from __future__ import annotations

import mido

__all__ = ["MidiStream"]

_LONGEST = 65_536  # bytes without a finished message, after which what was begun is forgotten


class MidiStream:
    """Bytes in, whole messages out. An instrument that begins a message and never ends it, or sends
    nothing but system-exclusive data, takes no more room than ``_LONGEST`` bytes.
    """

    def __init__(self) -> None:
        self._parser = mido.Parser()
        self._fed = 0

    def feed(self, data: bytes) -> list[bytes]:
        """The messages that ``data`` completes."""
        self._parser.feed(data)
        found = [bytes(message.bytes()) for message in self._parser]
        self._fed = 0 if found else self._fed + len(data)
        if self._fed > _LONGEST:
            self._parser, self._fed = mido.Parser(), 0
        return found
