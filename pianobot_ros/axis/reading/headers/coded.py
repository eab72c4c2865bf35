"""Headers that say a number of a standard: objects of CiA 402, data of Sercos drives."""

from __future__ import annotations

import re
from collections.abc import Collection

from pianobot_ros.axis.reading.headers.phrases import (
    joint_said,
    quantity_said,
    split_unit,
    unit_said,
)
from pianobot_ros.axis.reading.headers.record import Meaning
from pianobot_ros.axis.reading.headers.words import SERCOS, tokens

OBJECTS: dict[int, tuple[str, bool, str]] = {
    0x6062: ("position", True, ""),
    0x6063: ("position", False, ""),
    0x6064: ("position", False, ""),
    0x6069: ("velocity", False, ""),
    0x606B: ("velocity", True, ""),
    0x606C: ("velocity", False, ""),
    0x6071: ("effort", True, "‰"),
    0x6074: ("effort", True, "‰"),
    0x6077: ("effort", False, "‰"),
    0x6078: ("effort", False, "‰"),
    0x607A: ("position", True, ""),
    0x60F4: ("error", False, ""),
    0x60FC: ("position", True, ""),
    0x60FF: ("velocity", True, ""),
}
"""Quantity, whether commanded, and unit of objects of the drive profile CiA 402 by their index."""
AGAIN = {0x6063: 1, 0x6069: 2, 0x6071: 1, 0x6078: 1, 0x607A: 1, 0x60FC: 2}
"""Ranks of objects that say again what another one says: raw, or before the ramp."""
_INDEX = re.compile(
    r"(?<![0-9a-z])(?:0x|16#)?(6[0-9a-f]{3})h?(?:[:._ ](?:0x)?00?h?)?(?![0-9a-z])", re.IGNORECASE
)
IDENTS: dict[int, tuple[str, bool]] = {
    36: ("velocity", True),
    40: ("velocity", False),
    47: ("position", True),
    51: ("position", False),
    53: ("position", False),
    80: ("effort", True),
    84: ("effort", False),
    189: ("error", False),
}
"""Quantity, and whether commanded, of standard data of Sercos drives by the number in `S-0-0051`;
51 is read at the motor, 53 at what it moves, where both are there.
"""
AT_MOTOR, AT_LOAD = 51, 53


def cia402_object(header: str) -> Meaning | None:
    """What the index of an object of CiA 402 (`6064h`, `0x6064`, `6064:00`) in a header says."""
    found = next((m for m in _INDEX.finditer(header) if int(m[1], 16) in OBJECTS), None)
    if found is None:
        return None
    index = int(found[1], 16)
    quantity, command, unit = OBJECTS[index]
    bare, stated = split_unit(header[: found.start()] + " " + header[found.end() :])
    words = tokens(bare)
    unit = stated or unit or unit_said(words, quantity)
    joint = joint_said(words, quantity_said(words)[1] | {"internal"}, unit)
    return Meaning(header, quantity, command, joint, unit, AGAIN.get(index, 0))


def sercos_datum(header: str, headers: Collection[str]) -> Meaning | None:
    """What the number of a standard Sercos parameter (`S-0-0051`) in a header says; what stands
    before it is the axis.
    """
    index, axis = _ident(header)
    if index not in IDENTS:
        return None
    quantity, command = IDENTS[index]
    if index == AT_MOTOR and any(_ident(h)[0] == AT_LOAD for h in headers):
        quantity = "motor"
    return Meaning(header, quantity, command, joint_said(tokens(axis), ()), split_unit(header)[1])


def _ident(header: str) -> tuple[int, str]:
    """Number of the standard parameter that a header names, -1 if none, and what stands before."""
    found = SERCOS.search(header)
    if found is None or found[0][0] not in "sS":
        return -1, ""
    return int(found[1]), header[: found.start()]
