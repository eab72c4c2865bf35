"""Times of messages: ``builtin_interfaces/Time``."""

from __future__ import annotations

import struct
from typing import Any

__all__ = ["first_parts", "first_stamp", "nanoseconds", "seconds"]

_PARTS = struct.Struct("<iI")
_BODY = 4  # where the header begins


def first_parts(data: bytes) -> tuple[int, int]:
    """Whole seconds and nanoseconds of the stamp of a serialized message that begins with its
    header; 0 where it is too short for one.
    """
    if len(data) < _BODY + _PARTS.size:
        return 0, 0
    sec, nanosec = _PARTS.unpack_from(data, _BODY)
    return sec, nanosec


def first_stamp(data: bytes) -> int:
    """The same as ns since the epoch."""
    sec, nanosec = first_parts(data)
    return sec * 1_000_000_000 + nanosec


def nanoseconds(stamp: Any) -> int:
    """Nanoseconds since the epoch of a stamp; 0 where none was given."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def seconds(stamp: Any) -> float:
    """Seconds since the epoch of a stamp; 0 where none was given."""
    return float(stamp.sec) + float(stamp.nanosec) * 1e-9
