"""Time stamps apart from the numbers: in a file of their own, or again before each channel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pianobot_ros.axis.reading.formats.table import JOINTS, Table
from pianobot_ros.axis.reading.headers.meaning import meaning
from pianobot_ros.axis.reading.headers.vocabulary import WORDS
from pianobot_ros.axis.reading.headers.words import tokens
from pianobot_ros.gap.problem.types import Array

__all__ = ["clocks_of", "with_own_clocks", "with_time_file"]


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
        if in_turn and 1 < joints <= JOINTS:
            (numbers,) = columns.values()
            columns = {f"column{k}": numbers[k::joints] for k in range(joints)}
        same = {c.size for c in columns.values()} == {stamps.size}
        if same and not any(meaning(h).role == "time" for h in columns):
            table = replace(table, columns={"time": stamps, **columns})  # noqa: PLW2901
        out.append(table)
    return out if any("time" in t.columns for t in out) else list(tables)


def _is_time(table: Table) -> bool:
    return bool(set(tokens(table.name)) & WORDS["time"])


def clocks_of(table: Table, names: Mapping[str, str]) -> list[str]:
    """Columns under the first one's header, as it was written (`names`: header of each column),
    again before each channel, that rise in every row: the channel's time.
    """
    first = next(iter(names.values()), "")
    again = [n for n, header in names.items() if header == first]
    if not 1 < len(again) < len(names) or not all(n in table.columns for n in again):
        return []
    if meaning(first).role not in {"time", "other"}:
        return []
    return again if all(_rises(table.columns[n]) for n in again) else []


def with_own_clocks(table: Table, clocks: Sequence[str], unit: str) -> list[Table]:
    """A table whose channels each have one of these clocks, which count in `unit` ("" if nobody
    says so), as one table for those that share it.
    """
    name = clocks[0] if meaning(clocks[0]).quantity == "time" else "time"
    made: list[tuple[Array, dict[str, Array]]] = []
    for header, y in table.columns.items():
        if header in clocks:
            same = (k for k, (t, _) in enumerate(made) if _same(t, y))
            k = next(same, len(made))
            if k == len(made):
                made.append((y, {}))
        else:
            made[k][1][header] = y
    note = f"the column before each channel ({clocks[0]}) rises in every row and is its time"
    out = []
    for t, channels in made:
        rows = np.isfinite(t)
        columns = {name: t[rows], **{h: y[rows] for h, y in channels.items()}}
        units = {**table.units, **({name: unit} if unit else {})}
        out.append(replace(table, columns=columns, texts={}, units=units))
    said = table.notes if name == clocks[0] else (*table.notes, note)
    return [replace(t, notes=said if k == 0 else ()) for k, t in enumerate(out)]


def _rises(y: Array) -> bool:
    known = np.flatnonzero(np.isfinite(y))
    whole = known.size > 2 and known.size == known[-1] - known[0] + 1
    return bool(whole and np.all(np.diff(y[known]) > 0))


def _same(t: Array, y: Array) -> bool:
    """Whether two clocks never differ by half a step."""
    a, b = np.isfinite(t), np.isfinite(y)
    step = float(np.median(np.diff(t[a])))
    return np.array_equal(a, b) and float(np.max(np.abs(t[a] - y[a]))) < 0.5 * step
