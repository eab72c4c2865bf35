"""What a cell or a word of a text says: a number, a time, whose joint; rows of them as a table."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from pianobot_ros.axis.reading.formats.table import Table
from pianobot_ros.axis.reading.headers.unit_words import SECONDS, unit_of

__all__ = [
    "BRACKETS",
    "LIST",
    "RECEIVED",
    "comment",
    "compact",
    "joints_of",
    "measured",
    "number",
    "of_rows",
    "stamp",
    "value",
]

RECEIVED = "time_received"
"""Header of the stamps that a program writes before what it receives: a stamp within goes first."""
COMMENTS = ("#", "%", "//")
LIST = re.compile(r"^\s*[\[\(\{](.*)[\]\)\}]\s*$", re.DOTALL)
BRACKETS = str.maketrans(dict.fromkeys("[](){},;", " "))
_DURATION = re.compile(r"^([-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?)\s*([a-zµμ]+)$")
_MEASURE = re.compile(r"^([-+]?[\d.,]+(?:[eE][-+]?\d+)?)\s*([^\s\d.,].*)$")
_HEX = re.compile(r"^0[xX][0-9a-fA-F]+$")
_DAYS = re.compile(r"^(-?\d+) days?,? \+?(\d[\d:.]*)$")
_COMPACT = re.compile(
    r"^((?:19|20)\d\d)[-_]?(\d\d)[-_]?(\d\d)[-_T ]?(\d\d)[-_]?(\d\d)[-_]?(\d\d)[._,-]?(\d*)$"
)
"""`20240305_100050_123`, as programs call files."""
_SPAN = re.compile(
    r"^(?:P(?=\d+D|T)|L?(?:TIME|T)#)((?:T?\d+(?:\.\d+)?(?:[DHM]|[MUN]?S)_?)+)$", re.I
)
"""Durations as ISO 8601 (`PT1M2.5S`) and programs of PLCs write them (`T#1m2s500ms`)."""
_PART = re.compile(r"(\d+(?:\.\d+)?)([DHM]|[MUN]?S)(?![A-Z])", re.I)
_SPANS = {"d": 86400.0, "h": 3600.0, "m": 60.0, **SECONDS}
_PLC = re.compile(r"^L?(?:DT|TOD|DATE_AND_TIME|TIME_OF_DAY)#", re.I)
_DAY_FIRST = re.compile(r"^(\d{1,2})[-/. ]+([a-zä]{3,9})\.?[-/., ]+(\d{4})[T, ]+(.*)$", re.I)
_MONTH_FIRST = re.compile(r"^([a-zä]{3,9})\.? (\d{1,2}),? (\d{4}),? +(.*)$", re.I)
_MONTHS = ["jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"]
_GERMAN = {"mär": "mar", "mai": "may", "okt": "oct", "dez": "dec"}
_FRACTION = re.compile(r"(\d:\d\d)[:;](\d{3}|\d{6})$")
"""Of a second, behind a colon."""
_ZONE = re.compile(r"\s+(?:[A-Z]{3,5}|[A-Z][a-z]+/[A-Z][A-Za-z_]+)$")
"""A zone's name behind a time; another start for all rows."""
_AFTERNOON = re.compile(r"\s*([AaPp])\.?[Mm]\.?$")
_CLOCK = re.compile(r"^(?:(\d+):)?(\d{1,2}):(\d{1,2}(?:[.,]\d+)?)$")


def comment(line: str) -> bool:
    """Whether a line is a remark rather than a row."""
    return line.lstrip().startswith(COMMENTS)


def number(cell: str) -> float | None:
    """A number, a truth value, or None."""
    try:
        return float(cell) if "_" not in cell else None  # which Python would skip
    except ValueError:
        low = cell.strip().lower()
        return {"true": 1.0, "false": 0.0}.get(low, math.nan if low in {"", "na", "none"} else None)


def stamp(cell: str) -> float | None:
    """Seconds of a date (UTC unless it says otherwise), of hh:mm:ss, of `0 days hh:mm:ss`, or of a
    duration with its unit (`0.01 sec`, `PT1M2.5S`); else None.
    """
    cell = _PLC.sub("", _ZONE.sub("", cell.strip().strip("'\"[] ")))
    cell = _FRACTION.sub(r"\1.\2", cell)
    lasting = _duration(cell)
    return _date(_numbered(cell)) if lasting is None else lasting


def _duration(cell: str) -> float | None:
    """Seconds of a duration, or since midnight."""
    if m := _DURATION.match(cell):
        scale = SECONDS.get(unit_of(m[2]))
        return None if scale is None else scale * float(m[1])
    if m := _DAYS.match(cell):
        clock = stamp(m[2])
        return None if clock is None else 86400.0 * float(m[1]) + clock
    if m := _CLOCK.match(cell):
        return 3600.0 * float(m[1] or 0) + 60.0 * float(m[2]) + float(m[3].replace(",", "."))
    if m := _SPAN.match(cell):
        parts = _PART.findall(m[1].replace("_", ""))
        return float(sum(float(n) * _SPANS[unit.lower()] for n, unit in parts))
    return None


def _date(cell: str) -> float | None:
    """Seconds of a date and a time; where hours go up to 12, months stand before days."""
    if m := _COMPACT.match(cell):
        return _of_calendar([int(x) for x in m.groups()[:6]], m[7])
    afternoon = _AFTERNOON.search(cell)
    if len(cell) < 10 or not cell[:4].strip().isdigit():
        m = re.match(r"^(\d{1,2})[./](\d{1,2})[./](\d{4})(.*)$", cell)
        if m is None:
            return None
        american = int(m[1]) <= 12 and (afternoon or int(m[2]) > 12)
        day, month = (m[2], m[1]) if american else (m[1], m[2])
        cell = f"{m[3]}-{int(month):02d}-{int(day):02d}{m[4]}"
    if afternoon:
        cell = _AFTERNOON.sub("", cell)
    cell = re.sub(r"^(\d{4})[-/.](\d{2})[-/.](\d{2})-?", r"\1-\2-\3 ", cell).replace("Z", "+00:00")
    cell = re.sub(r"^(.{10}) +T?", r"\1 ", cell)
    fraction = re.search(r"[.,](\d+)", cell[10:])
    bare = cell[:10] + re.sub(r"[.,]\d+", "", cell[10:], count=1).rstrip()
    try:
        when = datetime.fromisoformat(bare.replace(" +", "+"))
    except ValueError:
        return None
    when = when if when.tzinfo else when.replace(tzinfo=timezone.utc)
    if afternoon:
        when = when.replace(hour=when.hour % 12 + (12 if afternoon[1] in "Pp" else 0))
    return when.timestamp() + (float(f"0.{fraction[1]}") if fraction else 0.0)


def compact(cell: str) -> bool:
    """Whether a cell is a date and a time without anything between but lines."""
    return _COMPACT.match(cell) is not None and stamp(cell) is not None


def _of_calendar(parts: Sequence[int], fraction: str) -> float | None:
    """Seconds of year, month, day, hour, minute and second, with the digits behind."""
    try:
        when = datetime(*parts, tzinfo=timezone.utc)  # type: ignore[misc, arg-type]
    except ValueError:
        return None
    return when.timestamp() + (float(f"0.{fraction}") if fraction else 0.0)


def _numbered(cell: str) -> str:
    """A date whose month has a name as one with its number (MATLAB's `05-Mar-2024 10:00:50`)."""
    if m := _DAY_FIRST.match(cell):
        day, month, year, clock = m.groups()
    elif m := _MONTH_FIRST.match(cell):
        month, day, year, clock = m.groups()
    else:
        return cell
    short = _GERMAN.get(month[:3].lower(), month[:3].lower())
    if short not in _MONTHS:
        return cell
    return f"{year}-{_MONTHS.index(short) + 1:02d}-{int(day):02d} {clock}"


def measured(cells: Sequence[str]) -> tuple[list[str], str] | None:
    """The numbers of cells that each have the same known unit behind (`12.5 deg`), and that unit;
    whole numbers of sixteen digits (`0x1F`) have none. None if cells are other words.
    """
    filled = [c for c in cells if c]
    if filled and all(map(_HEX.match, filled)):
        return [str(int(c, 16)) if c else "" for c in cells], ""
    found = [_MEASURE.match(c) if c else None for c in cells]
    units = {unit_of(m[2]) for m in found if m}
    if len(units) != 1 or units == {""} or sum(map(bool, found)) < len(filled):
        return None
    return [m[1] if m else "" for m in found], units.pop()


def joints_of(texts: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """Joint names that stand in every row: a column of lists, or `name0`, `name1`, …"""
    constant = {k: v[0] for k, v in texts.items() if "name" in k.lower() and len(set(v)) == 1}
    for word in constant.values():
        if LIST.match(word):
            return tuple(w.strip("'\"") for w in word.translate(BRACKETS).split())
    numbered = [(int(m[1]), v) for k, v in constant.items() if (m := re.search(r"(\d+)\]?$", k))]
    return tuple(v for _, v in sorted(numbered)) if numbered else ()


def of_rows(path: Path, name: str, rows: Sequence[Mapping[str, Any]], rate: float = 0.0) -> Table:
    """A table of rows that name their values; numbers may be written as texts."""
    columns, texts = {}, {}
    for key in dict.fromkeys(k for r in rows[:200] for k in r):
        values = [r.get(key) for r in rows]
        got = [value(v) for v in values]
        if sum(v is not None for v in got) >= 0.3 * len(got):
            columns[key] = np.array([math.nan if v is None else v for v in got])
        elif all(isinstance(v, str) or v is None for v in values):
            texts[key] = [str(v) for v in values]
    return Table(path, name, columns, texts, joints=joints_of(texts), rate=rate)


def value(cell: Any) -> float | None:
    """A number, also one that is written as a text; of a time its seconds; else None."""
    if isinstance(cell, (int, float)):
        return float(cell)
    if isinstance(cell, str):
        found = number(cell)
        return stamp(cell) if found is None else found
    return None
