"""What YARP's data dumper writes: a number, one or two stamps and a bottle a line, without headers,
as `data.log` in a folder that is called by what it holds, with an `info.log` beside it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from pianobot_ros.axis.reading.formats.lines.values import comment
from pianobot_ros.axis.reading.formats.table import Table
from pianobot_ros.gap.problem.types import Array

__all__ = ["as_dumped", "dumped", "without_brackets"]

STATE = [
    *("jointPosition", "jointVelocity", "jointAcceleration"),
    *("motorPosition", "motorVelocity", "motorAcceleration"),
    *("torque", "pwmDutycycle", "current", "controlMode", "interactionMode"),
]
"""Lists of a port `stateExt:o` in their order; behind each stands whether it is valid."""
NEAR = 60.0
"""s between the stamps of who sent and who received."""
_CELL = re.compile(r"\([^()]*\)|[^\s()]+")
_BOTTLE = re.compile(r"[^\s(),;]+(?:\s+(?:\([^(),;]*\)|[^\s(),;]+))+")


def dumped(path: Path) -> bool:
    """Whether a file is a data dumper's."""
    return path.name == "data.log" and (path.parent / "info.log").is_file()


def without_brackets(first: list[str], lines: Iterator[str]) -> tuple[list[str], Iterator[str]]:
    """Lines of numbers and lists in brackets with spaces between (`1 0.5 (1 2 3) 1`) as cells;
    others as they are.
    """
    rows = [x.strip() for x in first if x.strip() and not comment(x)]
    alike = sum("(" in x and _BOTTLE.fullmatch(x) is not None for x in rows)
    if not rows or alike < 0.8 * len(rows):
        return first, lines

    def cells(line: str) -> str:
        return line if comment(line) else "\t".join(_CELL.findall(line))

    return list(map(cells, first)), map(cells, lines)


def as_dumped(table: Table) -> Table:
    """The table of a data dumper with its folder's name, which is that of a plain bottle's numbers,
    and the names of a port `stateExt:o`, if it looks like one; others as they are.
    """
    if not table.headless or not dumped(table.path) or len(table.columns) < 3:
        return table
    name = table.path.parent.name
    heads = [h for h in table.columns if h != "column0"]
    stamps = heads[:2] if _stamps(table.columns[heads[0]], table.columns[heads[1]]) else heads[:1]
    called = dict(zip(stamps, ("time", "time_received"), strict=False))
    rest = [h for h in heads if h not in called]
    lists = list(dict.fromkeys(h.partition("[")[0] for h in rest if "[" in h))
    notes = table.notes
    if len(lists) == len(STATE):
        called |= {
            h: STATE[lists.index(stem)] + h.removeprefix(stem)
            for h in rest
            if (stem := h.partition("[")[0]) in lists
        }
        notes = (*notes, "no headers; taken as the lists of a port stateExt:o of YARP")
    elif not lists:
        called |= {h: f"{name}[{k}]" if len(rest) > 1 else name for k, h in enumerate(rest)}
    columns = {called[h]: table.columns[h] for h in heads if h in called}
    whole = len(lists) in {0, len(STATE)}
    return replace(
        table,
        name=name,
        columns=columns if whole else table.columns,
        headless=not whole,
        notes=notes,
    )


def _stamps(sent: Array, received: Array) -> bool:
    """Whether two columns (n,) are the stamps of the same messages."""
    apart = np.abs(sent - received)
    return bool(np.nanmax(apart) < NEAR and np.nanmin(sent) > NEAR)
