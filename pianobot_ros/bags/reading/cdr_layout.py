"""Many messages of one type at once, column by column.

Where a field of a serialized message (CDR) lies depends on the lengths of the strings and sequences
before it. Messages in which these are the same have one layout: it is found once, by the type's
definition, and numpy reads each number of all of them together.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

__all__ = ["CdrLayout", "Columns"]

Rows = NDArray[np.uint8]
_Read = Callable[[Rows], Any]
_BODY = 4  # bytes before the first field: they say how the rest is written
_CODES = {
    "bool": "?",
    "byte": "u1",
    "char": "u1",
    "uint8": "u1",
    "int8": "i1",
    **{f"{sign}int{8 * n}": f"{sign or 'i'}{n}" for sign in ("", "u") for n in (2, 4, 8)},
    "float32": "f4",
    "float64": "f8",
}
_NAMES = ("u1", "i1")  # sequences of these are taken as names of what follows them, as notes are


class Columns:
    """n messages as if they were one: a number of the message is an array (n,), a sequence of
    numbers a list of those; strings and sequences of bytes are the same in all.
    """

    def __init__(self, fields: Mapping[str, _Read], rows: Rows) -> None:
        self._fields, self._rows = fields, rows

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name not in self._fields:
            raise AttributeError(name)
        return self._fields[name](self._rows)


class CdrLayout:
    """Where the fields of one message of the type ``kind`` lie.

    Args:
        store: the definitions.
        kind: package/msg/Name.
        data: the serialized message, which the store can deserialize.
    """

    def __init__(self, store: Typestore, kind: str, data: bytes) -> None:
        self._store, self._data = store, data
        self._order = "<" if data[1] else ">"
        self._at = 0
        self._same: list[range] = [range(_BODY)]
        self._fields = dict(self._message(kind))
        places = np.array([place for part in self._same for place in part])
        self._places, self._key = places, np.frombuffer(data, np.uint8)[places]

    def shared_by(self, rows: Rows) -> NDArray[np.bool_]:
        """Which messages (n, bytes), all as long as the first, have this layout."""
        return np.asarray((rows[:, self._places] == self._key).all(axis=1))

    def columns(self, rows: Rows) -> Columns:
        """The fields of messages (n, bytes) of this layout."""
        return Columns(self._fields, rows)

    def _message(self, kind: str) -> Iterator[tuple[str, _Read]]:
        for name, (node, what) in self._store.fielddefs[kind][1]:
            yield name, self._field(node, what)

    def _field(self, node: Nodetype, what: Any) -> _Read:
        if node == Nodetype.NAME:
            fields = dict(self._message(what))
            return lambda rows: Columns(fields, rows)
        if node == Nodetype.BASE:
            return self._string() if what[0] == "string" else self._number(_CODES[what[0]])
        (inner, of), count = what
        if node == Nodetype.SEQUENCE:
            count = self._count()
        if inner == Nodetype.BASE and of[0] != "string":
            return self._numbers(_CODES[of[0]], count, named=node == Nodetype.SEQUENCE)
        reads = [self._field(inner, of) for _ in range(count)]
        return lambda rows: [read(rows) for read in reads]

    def _skip(self, size: int, aligned: int) -> int:
        """Where a field of ``size`` bytes begins in the message."""
        start = -(-self._at // aligned) * aligned
        self._at = start + size
        return _BODY + start

    def _count(self) -> int:
        start = self._skip(4, 4)
        self._same.append(range(start, start + 4))
        return int(struct.unpack_from(f"{self._order}I", self._data, start)[0])

    def _string(self) -> _Read:
        start = self._skip(length := self._count(), 1)
        self._same.append(range(start, start + length))
        text = self._data[start : start + length - 1].decode()
        return lambda rows: text

    def _number(self, code: str) -> _Read:
        numbers = self._numbers(code, 1, named=False)
        return lambda rows: numbers(rows)[0]

    def _numbers(self, code: str, count: int, *, named: bool) -> _Read:
        dtype = np.dtype("u1" if code == "?" else self._order + code)
        size = dtype.itemsize
        start = self._skip(count * size, size) if count else 0
        end = start + count * size
        if named and code in _NAMES:
            self._same.append(range(start, end))
            names = np.frombuffer(self._data, dtype, count, start if count else 0).tolist()
            return lambda rows: names

        def read(rows: Rows) -> Sequence[Any]:
            found = np.ascontiguousarray(rows[:, start:end]).view(dtype).reshape(len(rows), count)
            return list((found != 0 if code == "?" else found).T)

        return read
