"""Messages that are published many times a second: serialized once, then only their numbers are
replaced.

Filling a message object and having rclpy convert it costs several times as much as writing a few
numbers into its bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from rclpy.serialization import deserialize_message, serialize_message

__all__ = ["Template", "sender"]

_STAMP = struct.Struct("<iI")
_STAMP_AT = (
    4  # behind the encapsulation header: a message begins with its header, a header with its stamp
)


class Template:
    """One message of fixed length whose ``fields`` change.

    ``fields`` gives each name (``a__b`` for ``a.b``) the format of ``struct``: ``d`` for a float,
    ``7d`` for seven floats in a row (all numbers of a Pose, or of a float array), ``i``, ``I``,
    ``B``, ``?``. Arrays must have their final length in ``message``, which must begin with a header
    and is used up.
    """

    def __init__(self, message: Any, **fields: str) -> None:
        self._places: dict[str, tuple[Callable[..., None], int]] = {}
        for name, form in fields.items():
            packed = struct.Struct("<" + form)
            self._places[name] = packed.pack_into, _place(message, name.split("__"), packed)
        self._data = bytearray(_serialized(message))

    def fill(self, stamp_ns: int, **values: float | Sequence[float]) -> bytes:
        """What a publisher takes: the message, stamped ``stamp_ns`` since the epoch, with these
        values, the others as before.
        """
        data = self._data
        _STAMP.pack_into(data, _STAMP_AT, *divmod(stamp_ns, 1_000_000_000))
        for name, value in values.items():
            pack_into, place = self._places[name]
            if isinstance(value, (int, float)):
                pack_into(data, place, value)
            else:
                pack_into(data, place, *value)
        return bytes(data)


def sender(publisher: Any) -> Callable[[bytes], None]:
    """What ``publisher.publish`` does with bytes, in half the time: it asks of each message anew
    what it is.
    """
    handle = publisher.handle
    publish = handle.publish_raw

    def send(data: bytes) -> None:
        with handle:
            publish(data)

    return send


def _serialized(message: Any) -> bytes:
    """The message's bytes without what the middleware reserves too much behind an empty array,
    which strict readers refuse.
    """
    data = bytes(serialize_message(message))
    while True:
        try:
            deserialize_message(data[:-1], type(message))
        except RuntimeError:  # too short
            return data
        data = data[:-1]


def _place(message: Any, path: list[str], packed: struct.Struct) -> int:
    """Where the field is: the one row of bytes that follows its numbers. ValueError if they do not
    lie in a row.

    Other bytes may differ too: the middleware leaves what it pads with as it finds it in memory.
    """
    ones, zeros = b"\x01" * packed.size, bytes(packed.size)
    different = packed.unpack(ones)
    _set(message, path, different)
    one = bytes(serialize_message(message))
    _set(message, path, tuple(type(value)(0) for value in different))
    zero = bytes(serialize_message(message))
    places = [i for i in range(len(one)) if one.startswith(ones, i) and zero.startswith(zeros, i)]
    if len(places) != 1:
        raise ValueError(f"{'.'.join(path)} is not {packed.format} in {type(message).__name__}")
    return places[0]


def _set(message: Any, path: Sequence[str], values: Sequence[Any]) -> None:
    for part in path[:-1]:
        message = getattr(message, part)
    name = path[-1]
    now = getattr(message, name)
    if hasattr(now, "get_fields_and_field_types"):
        try:
            _fill(now, iter(values))
        except StopIteration:
            raise ValueError(f"{'.'.join(path)} has more than {len(values)} numbers") from None
    elif isinstance(now, (bool, int, float)):
        setattr(message, name, values[0])
    else:
        setattr(message, name, list(values))


def _fill(message: Any, numbers: Iterator[Any]) -> None:
    """All numbers of a nested message, in order."""
    for name in message.get_fields_and_field_types():
        part = getattr(message, name)
        if hasattr(part, "get_fields_and_field_types"):
            _fill(part, numbers)
        else:
            setattr(message, name, next(numbers))
