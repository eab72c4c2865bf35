"""A log as one file for each signal, with the time stamps in a file of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from pianobot_ros.axis.reading.formats.table import Table
from pianobot_ros.axis.reading.names import WORDS, meaning, tokens

__all__ = ["with_time_file"]

MOST = 64
"""Joints of a robot, whose numbers follow each other in one column."""


def with_time_file(tables: Sequence[Table]) -> list[Table]:
    """The tables of one run with the stamps of the one that is called time, where the others have
    none: as many rows, or one column with as many numbers for each of several joints in turn.
    """
    clocks = [t for t in tables if t.headless and len(t.columns) == 1 and _is_time(t)]
    if len(clocks) != 1 or len(tables) < 2:
        return list(tables)
    (stamps,) = clocks[0].columns.values()
    out = []
    for table in tables:
        if table is clocks[0]:
            continue
        columns = dict(table.columns)
        joints = table.size // stamps.size if stamps.size else 0
        in_turn = len(columns) == 1 and table.headless and table.size == joints * stamps.size
        if in_turn and 1 < joints <= MOST:
            (numbers,) = columns.values()
            columns = {f"column{k}": numbers[k::joints] for k in range(joints)}
        same = {c.size for c in columns.values()} == {stamps.size}
        if same and not any(meaning(h).role == "time" for h in columns):
            table = replace(table, columns={"time": stamps, **columns})  # noqa: PLW2901
        out.append(table)
    return out if any("time" in t.columns for t in out) else list(tables)


def _is_time(table: Table) -> bool:
    return bool(set(tokens(table.name)) & WORDS["time"])
