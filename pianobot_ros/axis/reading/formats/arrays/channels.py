"""Channels that a text describes and files beside it hold: traces of KUKA's controllers, DIAdem."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pianobot_ros.axis.reading.formats.table import Table, stem_of
from pianobot_ros.axis.reading.headers.unit_words import unit_of
from pianobot_ros.gap.problem.errors import GapError
from pianobot_ros.gap.problem.types import Array

__all__ = ["channel_tables", "described"]

BEGINS, ENDS = "#BEGINCHANNELHEADER", "#ENDCHANNELHEADER"
NAME, UNIT, IMPLICIT, FILE, ORDER, KIND, LENGTH, FIRST, OFFSET, FACTOR = (
    *("200", "202", "210", "211", "213", "214", "220", "221", "240", "241"),
)
"""Numbers of the lines that say so."""
MOST_ROWS = 100_000_000
"""Beyond, a header is wrong or the memory too small."""
KINDS = {
    **{"REAL64": "<f8", "REAL32": "<f4", "INT32": "<i4", "WORD32": "<u4"},
    **{"INT16": "<i2", "WORD16": "<u2", "WORD8": "u1"},
}


def described(path: Path) -> bool:
    """Whether a text file describes channels rather than holding numbers."""
    with path.open("rb") as file:
        return b"#BEGINGLOBALHEADER" in file.read(200)


def channel_tables(path: Path) -> list[Table]:
    """The table of a header file and of the files with numbers that it names; every channel is a
    factor times what is written plus an offset, an implicit one the factor times the row's number.
    """
    channels = _channels(path.read_text(encoding="cp1252", errors="replace"))
    files = [c.get(FILE, "") for c in channels]
    columns: dict[str, Array] = {}
    units: dict[str, str] = {}
    for c in channels:
        try:
            rows, scale = int(c[LENGTH]), float(c.get(FACTOR, 1))
            if rows > MOST_ROWS:
                raise GapError(f"{path.name}: a channel of {rows} rows; at most {MOST_ROWS}")
            if c[IMPLICIT].upper().startswith("IMPLI"):
                raw: Array = np.arange(rows, dtype=float)
            else:
                raw = _numbers(path, c, rows, files.count(c[FILE]))
            columns[c[NAME]] = scale * raw + float(c.get(OFFSET, 0))
        except (KeyError, ValueError):
            raise GapError(f"{path.name}: the header of a channel lacks its size or file") from None
        if unit := unit_of(c.get(UNIT, "")):
            units[c[NAME]] = unit
    least = min((y.size for y in columns.values()), default=0)
    columns = {name: y[:least] for name, y in columns.items()}
    return [Table(path, stem_of(path), columns, units=units)] if least else []


def _channels(text: str) -> list[dict[str, str]]:
    """What the lines of each channel say, by their numbers."""
    out: list[dict[str, str]] = []
    inside = False
    for line in text.splitlines():
        if line.strip() in {BEGINS, ENDS}:
            inside = line.strip() == BEGINS
            out += [{}] if inside else []
        elif inside:
            key, _, value = line.partition(",")
            out[-1][key.strip()] = value.strip()
    return out


def _numbers(path: Path, channel: dict[str, str], rows: int, width: int) -> Array:
    """Numbers (n,) of a channel that is written as a block of its own, or (BLOCK) in rows with the
    `width` channels of its file.
    """
    file = path.with_name(Path(channel[FILE].replace("\\", "/")).name)
    kind = KINDS.get(channel.get(KIND, ""))
    if not file.is_file() or kind is None:
        what = "is not beside it" if kind else f"holds {channel.get(KIND)}, which is not read"
        raise GapError(f"{path.name}: its numbers are in {file.name}, which {what}; give both")
    first = int(channel.get(FIRST, 1)) - 1
    step = width if channel.get(ORDER, "").upper() == "BLOCK" else 1
    return np.fromfile(file, kind)[first::step][:rows].astype(float)
