"""Columns of numbers out of many serialized messages of one topic at once.

The fields wanted lie at a fixed place in all messages of one publisher, since only names (frame,
fingers) have variable length and those do not change. So the place is found once in the first
message, and numpy reads the rest. The layout is little-endian CDR: a header of 4 bytes, then fields
aligned to their size.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence

import numpy as np

from pianobot_ros.cell.arrays import Array

__all__ = ["angle_place", "columns", "force_place", "table", "vacuum_place", "wrist_place"]

Place = Callable[[bytes], int | None]
_BODY = 4


def _align(offset: int, size: int) -> int:
    return -(-offset // size) * size


def _uint(data: bytes, offset: int) -> int:
    return int(struct.unpack_from("<I", data, _BODY + offset)[0])


def _after_header(data: bytes) -> int:
    return 12 + _uint(data, 8)


def wrist_place(axis: int) -> Place:
    """x, y, z (axis 0 to 2) or the quaternion's x, y, z, w (3 to 6) of the pose in a WristState or
    WristCommand.
    """
    return lambda data: _align(_after_header(data), 8) + 8 * axis


def force_place(data: bytes) -> int | None:
    """``force`` of a KeyForce."""
    return _align(_after_header(data) + 1, 8)


def _skip_floats(data: bytes, offset: int) -> tuple[int, int]:
    """Start and end of a sequence of float64."""
    offset = _align(offset, 4)
    count = _uint(data, offset)
    start = _align(offset + 4, 8) if count else offset + 4
    return start, start + 8 * count


def vacuum_place(finger: str, array: int = 1) -> Place:
    """One finger's number in a VacuumState (``array`` 0: ``setpoint``, 1: ``measured``) or
    VacuumCommand (0: ``pressure``).
    """

    def place(data: bytes) -> int | None:
        at = _align(_after_header(data), 4)
        names, offset = [], at + 4
        for _ in range(_uint(data, at)):
            offset = _align(offset, 4)
            length = _uint(data, offset)
            names.append(data[_BODY + offset + 4 : _BODY + offset + 3 + length].decode())
            offset += 4 + length
        start, end = _skip_floats(data, offset)
        for _ in range(array):
            start, end = _skip_floats(data, end)
        known = finger in names and end - start >= 8 * len(names)
        return start + 8 * names.index(finger) if known else None

    return place


def angle_place(note: int) -> Place:
    """``angle`` of one key in a KeyAngle."""

    def place(data: bytes) -> int | None:
        at = _align(_after_header(data), 4)
        notes = data[_BODY + at + 4 : _BODY + at + 4 + _uint(data, at)]
        start, _ = _skip_floats(data, at + 4 + len(notes))
        return start + 8 * notes.index(note) if note in notes else None

    return place


def _find(place: Place, data: bytes) -> int | None:
    """Where the field lies; None in a message that is cut or garbled."""
    try:
        return place(data)
    except (struct.error, UnicodeDecodeError):
        return None


def columns(messages: Sequence[bytes], place: Place) -> tuple[Array, Array]:
    """Stamps (n,) s and values (n,) of the messages, in order of stamp. Messages without the field
    are left out.
    """
    times, values = table(messages, [place])
    return times, values[:, 0]


def table(messages: Sequence[bytes], places: Sequence[Place]) -> tuple[Array, Array]:
    """Stamps (n,) s and values (n, fields) of the messages, in order of stamp; those without one of
    the fields are left out.
    """
    groups: dict[int, list[bytes]] = {}
    for data in messages:
        groups.setdefault(len(data), []).append(data)
    times, values = [], []
    for length, group in groups.items():
        offsets = [_find(place, group[0]) for place in places]
        if any(offset is None or _BODY + offset + 8 > length for offset in offsets):
            continue
        rows = np.frombuffer(b"".join(group), dtype=np.uint8).reshape(len(group), length)
        seconds = rows[:, _BODY : _BODY + 8].copy().view("<u4")
        times.append(seconds[:, 0] + 1e-9 * seconds[:, 1])
        bytes_ = np.concatenate(
            [rows[:, _BODY + o : _BODY + o + 8] for o in offsets if o is not None], axis=1
        )
        values.append(np.ascontiguousarray(bytes_).view("<f8"))
    if not times:
        return np.empty(0), np.empty((0, len(places)))
    time, value = np.concatenate(times), np.concatenate(values)
    order = np.argsort(time, kind="stable")
    return time[order], value[order]
