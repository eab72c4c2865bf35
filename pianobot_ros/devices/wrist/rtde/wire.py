"""Wire format of RTDE (protocol version 2).

Every message is a big-endian header ``uint16 size, uint8 type`` and a payload; ``size`` counts the
header.
Source: Universal Robots, "Real-Time Data Exchange (RTDE) Guide".
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

__all__ = ["FORMATS", "LENGTHS", "Framer", "MessageType", "frame"]

_HEADER = struct.Struct(">HB")


class MessageType:
    """Type byte of a message."""

    REQUEST_PROTOCOL_VERSION = 86  # 'V'
    GET_CONTROLLER_VERSION = 118  # 'v'
    TEXT_MESSAGE = 77  # 'M'
    DATA_PACKAGE = 85  # 'U'
    SETUP_OUTPUTS = 79  # 'O'
    SETUP_INPUTS = 73  # 'I'
    START = 83  # 'S'
    PAUSE = 80  # 'P'


FORMATS = {
    "BOOL": "?",
    "UINT8": "B",
    "UINT32": "I",
    "UINT64": "Q",
    "INT32": "i",
    "DOUBLE": "d",
    "VECTOR3D": "3d",
    "VECTOR6D": "6d",
    "VECTOR6INT32": "6i",
    "VECTOR6UINT32": "6I",
}
"""``struct`` format of each RTDE type."""

LENGTHS = {"VECTOR3D": 3, "VECTOR6D": 6, "VECTOR6INT32": 6, "VECTOR6UINT32": 6}
"""Number of elements of the vector types; the others are scalars."""


def frame(kind: int, payload: bytes = b"") -> bytes:
    """One message, ready to send."""
    return _HEADER.pack(_HEADER.size + len(payload), kind) + payload


class Framer:
    """Splits a byte stream into messages."""

    def __init__(self) -> None:
        self._buffer = b""

    def feed(self, data: bytes) -> Iterator[tuple[int, bytes]]:
        """Type and payload of every message that ``data`` completes.

        Raises:
            ValueError: a size field smaller than a header, so that the stream cannot be followed
                any more.
        """
        self._buffer += data
        while len(self._buffer) >= _HEADER.size:
            size, kind = _HEADER.unpack_from(self._buffer)
            if size < _HEADER.size:
                raise ValueError(f"RTDE message with impossible size {size}")
            if len(self._buffer) < size:
                return
            payload, self._buffer = self._buffer[_HEADER.size : size], self._buffer[size:]
            yield kind, payload
