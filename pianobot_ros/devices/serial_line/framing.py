"""Framing of the line protocol (docs/serial-protocol.md): ``KIND,SEQUENCE[,FIELD...]*CRC`` and a
line feed.
"""

from __future__ import annotations

import binascii
import re
from dataclasses import dataclass
from typing import NamedTuple

__all__ = [
    "MAX_LINE",
    "PROTOCOL_VERSION",
    "SEQUENCE_SPAN",
    "Line",
    "LineParser",
    "LineStatistics",
    "crc16",
    "encode",
]

PROTOCOL_VERSION = 1
MAX_LINE = 160
"""Longest line in bytes without its end; whatever is longer is not a line."""
SEQUENCE_SPAN = 1 << 16

ANSWERS = "AEI"
"""Kinds of answers. They carry the sequence number of the command, not the device's own."""

MEMORY = 100  # lines
_RESTART = SEQUENCE_SPAN // 2
_INTEGER = re.compile(r"-?[0-9]{1,12}")


def crc16(data: bytes) -> int:
    """CRC-16/IBM-3740 (also CCITT-FALSE): polynomial 0x1021, start 0xFFFF, check value of
    ``123456789`` 0x29B1.
    """
    return binascii.crc_hqx(data, 0xFFFF)


class Line(NamedTuple):
    """One intact line: ``kind`` is one capital letter, ``sequence`` 0 to 65535, ``fields`` the rest
    as text.
    """

    kind: str
    sequence: int
    fields: tuple[str, ...]

    def integers(self, *bounds: tuple[int, int]) -> list[int]:
        """The fields as decimal integers, each within its bounds, inclusive.

        Raises ValueError if there are more or fewer fields, or one is no integer or out of bounds.
        A line can check and still be wrong: the device's memory, or its programmer, can be at
        fault.
        """
        if len(self.fields) != len(bounds):
            raise ValueError(f"{self.kind} has {len(self.fields)} fields, not {len(bounds)}")
        numbers = []
        for text, (low, high) in zip(self.fields, bounds, strict=True):
            number = int(text) if _INTEGER.fullmatch(text) else None
            if number is None or not low <= number <= high:
                raise ValueError(f"field '{text}' of {self.kind} is not in {low} to {high}")
            numbers.append(number)
        return numbers


def encode(kind: str, sequence: int, *fields: object) -> bytes:
    """The bytes of one line, end included.

    Raises ValueError for what the protocol cannot carry: a kind that is no capital letter, a field
    with a comma, an asterisk or something that is not printable ASCII, or a line that is too long.
    """
    if len(kind) != 1 or not "A" <= kind <= "Z":
        raise ValueError(f"kind of line '{kind}' is not one capital letter")
    body = ",".join([kind, str(sequence % SEQUENCE_SPAN), *map(str, fields)])
    if (
        body.count(",") != len(fields) + 1
        or "*" in body
        or not (body.isascii() and body.isprintable())
    ):
        raise ValueError(f"line '{body}' has a field that cannot be sent")
    data = body.encode("ascii")
    if len(data) + 5 > MAX_LINE:
        raise ValueError(f"line of {len(data)} bytes is longer than the protocol allows")
    return b"%s*%04X\n" % (data, crc16(data))


@dataclass
class LineStatistics:
    """What came over the wire: ``good`` lines, ``bad`` ones (garbled, cut or not of this protocol),
    ``lost`` by gaps in the sequence number, ``restarts`` of the device's counter; ``bad_share`` of
    the last :data:`MEMORY` lines or so, 0 to 1 (each counts a hundredth less than the next)."""

    good: int = 0
    bad: int = 0
    lost: int = 0
    restarts: int = 0
    bad_share: float = 0.0

    def count(self, good: bool) -> None:
        """One line more."""
        self.good += good
        self.bad += not good
        self.bad_share += ((not good) - self.bad_share) / MEMORY


class LineParser:
    """Bytes in, intact lines out. It never raises, and finds its feet again at the next line feed.

    ``statistics`` counts over the parser's life; :meth:`reset` forgets half a line and the last
    sequence number, as is right after a reconnection.
    """

    def __init__(self) -> None:
        self.statistics = LineStatistics()
        self._rest = b""
        self._skipping = False
        self._last: int | None = None
        self._cut = True

    def reset(self) -> None:
        """Forget what was received in part. The first, probably cut line afterwards is not counted
        as bad.
        """
        self._rest = b""
        self._skipping = False
        self._last = None
        self._cut = True

    def feed(self, data: bytes) -> list[Line]:
        """The lines that are complete with ``data``, in order."""
        *pieces, rest = (self._rest + data).split(b"\n")
        lines = []
        for piece in pieces:
            if (
                self._skipping
            ):  # the end of something too long, which was counted when it was dropped
                self._skipping = False
                continue
            if not piece or piece == b"\r":
                continue
            line = _decode(piece)
            if line is not None:
                self._count(line)
                lines.append(line)
            elif not self._cut:
                self.statistics.count(good=False)
            self._cut = False
        if len(rest) > MAX_LINE + 1:
            if not self._skipping:
                self.statistics.count(good=False)
            self._skipping, rest = True, b""
        self._rest = rest
        return lines

    def _count(self, line: Line) -> None:
        statistics = self.statistics
        statistics.count(good=True)
        if line.kind in ANSWERS:
            return
        sequence = line.sequence
        if self._last is not None:
            gap = (sequence - self._last - 1) % SEQUENCE_SPAN
            if gap < _RESTART:
                statistics.lost += gap
            else:
                statistics.restarts += 1
        self._last = sequence


def _decode(data: bytes) -> Line | None:
    data = data.rstrip(b"\r")
    body, star, check = data.rpartition(b"*")
    if not star or len(check) != 4 or len(data) > MAX_LINE:
        return None
    try:
        if int(check, 16) != crc16(body):
            return None
        kind, sequence, *fields = body.decode("ascii").split(",")
        number = int(sequence)
    except ValueError:
        return None
    if len(kind) != 1 or not "A" <= kind <= "Z" or not 0 <= number < SEQUENCE_SPAN:
        return None
    return Line(kind, number, tuple(fields))
