"""A WristCommand as plain numbers, also straight from its bytes: each setpoint of a stream is read
by both cells, and to make a message of it costs several times as much as to obey it.
"""

from __future__ import annotations

import struct
from typing import Any, NamedTuple

from pianobot_ros.cell.errors import CommandRejectedError
from pianobot_ros.cell.messages.poses import position, quaternion

__all__ = ["WristOrder"]

_LITTLE_ENDIAN = b"\x00\x01"  # plain CDR
_BEGIN = struct.Struct("<iII")  # stamp, and the length of the frame's name with its final zero
_NUMBERS = struct.Struct("<13d")
_BODY = 4  # where the body begins, from which fields are aligned


class WristOrder(NamedTuple):
    """What a WristCommand says: its ``frame``, its stamp in whole seconds ``sec`` since the epoch
    and ``nanosec``, and ``numbers``: position m, quaternion x, y, z, w, velocity m/s and rad/s.
    """

    frame: str
    sec: int
    nanosec: int
    numbers: tuple[float, ...]

    @classmethod
    def of(cls, message: Any) -> WristOrder:
        """What the message says."""
        header, v, w = message.header, message.twist.linear, message.twist.angular
        pose = (*position(message.pose), *quaternion(message.pose))
        stamp = header.stamp
        numbers = (*pose, v.x, v.y, v.z, w.x, w.y, w.z)
        return cls(header.frame_id, int(stamp.sec), int(stamp.nanosec), numbers)

    @classmethod
    def read(cls, data: bytes) -> WristOrder:
        """What the serialized message says. Raises :class:`CommandRejectedError` for bytes that
        are no such message.
        """
        try:
            sec, nanosec, length = _BEGIN.unpack_from(data, _BODY)
            begin = _BODY + _BEGIN.size
            frame = str(data[begin : begin + length].rstrip(b"\x00"), "utf-8")
            place = begin + length
            numbers = _NUMBERS.unpack_from(data, place + (_BODY - place) % 8)
        except (struct.error, UnicodeDecodeError) as error:
            raise CommandRejectedError(f"wrist setpoint is damaged: {error}") from None
        if data[:2] != _LITTLE_ENDIAN:
            raise CommandRejectedError("wrist setpoint is not in little-endian CDR")
        return cls(frame, sec, nanosec, numbers)

    @property
    def stamp(self) -> float:
        """When it is to be obeyed, s since the epoch; 0 where none was given."""
        return self.sec + 1e-9 * self.nanosec

    @property
    def stamp_ns(self) -> int:
        """The same in ns."""
        return self.sec * 1_000_000_000 + self.nanosec
