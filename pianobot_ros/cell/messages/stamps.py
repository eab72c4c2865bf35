"""Times of messages: ``builtin_interfaces/Time``."""

from __future__ import annotations

import struct
from typing import Any

__all__ = ["first_stamp", "nanoseconds", "seconds"]


def first_stamp(data: bytes) -> int:
    """Stamp, ns since the epoch, of a serialized message that begins with its header."""
    sec, nanosec = struct.unpack_from("<iI", data, 4)
    return int(sec) * 1_000_000_000 + int(nanosec)


def nanoseconds(stamp: Any) -> int:
    """Nanoseconds since the epoch of a stamp; 0 where none was given."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def seconds(stamp: Any) -> float:
    """Seconds since the epoch of a stamp; 0 where none was given."""
    return float(stamp.sec) + float(stamp.nanosec) * 1e-9
