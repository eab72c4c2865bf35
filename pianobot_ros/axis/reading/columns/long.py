"""Tables with a row for each joint and time, or for each signal and time, as tables with a column
for each signal of each joint.

Rows of one signal each are what databases and plotting programs export: InfluxDB's annotated CSV
(`_time,_value,_field,_measurement`, docs.influxdata.com), Foxglove's plots (`elapsed time,receive
time,header.stamp,topic,value`), historians (`Tagname,TimeStamp,Value,DataQuality`), WinCC
(`VarName;TimeString;VarValue;Validity;Time_ms`) and traces as `Time,Signal,Value,Unit`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.axis.reading.columns.clock import onto
from pianobot_ros.axis.reading.columns.matching import SIGNALS
from pianobot_ros.axis.reading.formats.table import JOINTS, Table
from pianobot_ros.axis.reading.headers.meaning import meaning
from pianobot_ros.axis.reading.headers.record import Meaning
from pianobot_ros.axis.reading.headers.unit_words import unit_of
from pianobot_ros.axis.reading.headers.words import tokens
from pianobot_ros.gap.problem.types import Array

__all__ = ["by_joint", "side_by_side"]

WHO = {"joint", "joints", "name", "names", "motor", "motors", "axis", "axes", "servo", "id"}
WHO |= {"device", "node"}
"""Words of a header that says whose a row is."""
ROBOTS = {"robot", "robots", "arm", "arms", "side", "agent", "manipulator", "leg", "hand", "limb"}
"""Words of a header that says which of several robots a row is of."""
ONCE = 0.98
"""Share of the rows that are the only ones of their joint at their time, where nothing is mixed."""
VALUE = {"value", "values", "val", "reading", "wert", "messwert", "valeur", "valor", "valore"}
"""Words of a header that says of its numbers only that they are some."""
WHAT = {"signal", "signals", "variable", "var", "tag", "tagname", "channel", "field", "topic"}
WHAT |= {"series", "metric", "parameter", "quantity", "symbol", "measurement", "key", "label"}
WHAT |= {"varname", "name", "sensor", "kanal", "groesse", "bezeichnung"}
"""Words of a header that says what a row is of."""
ASIDE = {"unit", "units", "einheit", "quality", "validity", "status", "type", "datatype", "result"}
"""Words of a header of words that say something else of a row."""
MANY = 8 * JOINTS
"""Signals that a table may hold."""
FEW = 5
"""Rows that each signal has on average, at least."""


def side_by_side(table: Table) -> Table:
    """A table whose rows are each of one signal, a time, a name and a value, as one with a column
    for each signal, on the clock of the positions; other tables as they are.
    """
    found = _values(table)
    clock = _clock(table) if found else ""
    named = _named(table) if clock else None
    if not clock or named is None:
        return table
    which, names = named
    stamps, y = table.columns[clock], table.columns[found]
    known = np.isfinite(stamps) & np.isfinite(y)
    rows = {n: np.flatnonzero(known & (which == k)) for k, n in enumerate(names)}
    rows = {n: r[np.argsort(stamps[r], kind="stable")] for n, r in rows.items() if r.size > 1}
    if not rows:
        return table
    first = max(rows, key=lambda n: (meaning(n).role == "position", rows[n].size))
    grid = stamps[rows[first]]
    columns = {clock: grid}
    for n, own in rows.items():
        times = stamps[own]
        if not np.array_equal(times, grid):  # stamps of its own
            times, once = np.unique(times, return_index=True)
            columns[n] = onto(grid, times, y[own][once])
        else:
            columns[n] = y[own]
    said = f"a row for each time and signal; {len(rows)} signals laid side by side"
    units = {**{k: u for k, u in table.units.items() if k == clock}, **_units(table, which, names)}
    made = replace(table, columns=columns, texts={}, units=units)
    return replace(made, notes=(*table.notes, said), headless=False)


def _values(table: Table) -> str:
    """The header of the only numbers of a table of such rows, "" if others say a signal."""
    if not table.texts or any(meaning(h).role in SIGNALS for h in table.columns):
        return ""
    found = [h for h in table.columns if VALUE & set(tokens(h))]
    return found[0] if len(found) == 1 else ""


def _clock(table: Table) -> str:
    """The header of the stamps: of several those that tell most times apart."""
    named = [m for m in map(meaning, table.columns) if m.quantity == "time"]
    apart = {m.header: np.unique(table.columns[m.header][:10_000]).size for m in named}
    moving = [m for m in named if apart[m.header] > 1]
    return min(moving, key=lambda m: (-apart[m.header], m.rank)).header if moving else ""


def _named(table: Table) -> tuple[NDArray[np.intp], list[str]] | None:
    """The number of each row's signal, and all signals' names: the words of the columns that tell
    what rows are of, one after the other; None if none does.
    """
    told = [h for h, w in table.texts.items() if len(w) == table.size and not _aside(h)]
    told.sort(key=lambda h: not WHAT & set(tokens(h)))
    which, names = np.zeros(table.size, np.intp), [""]
    for h in told:
        pairs = zip(which.tolist(), table.texts[h], strict=True)
        number: dict[tuple[int, str], int] = {}
        finer = np.array([number.setdefault(p, len(number)) for p in pairs], np.intp)
        if len(names) < len(number) <= min(MANY, table.size // FEW):  # else it says nothing new
            which, names = finer, [f"{names[k]} {word}".strip() for k, word in number]
    return (which, names) if len(names) > 1 else None


def _aside(header: str) -> bool:
    """Whether words under a header are none of what tells rows apart: a unit, a time, a quality."""
    return bool(ASIDE & set(tokens(header))) or meaning(header).quantity == "time"


def _units(table: Table, which: NDArray[np.intp], names: Sequence[str]) -> Mapping[str, str]:
    """Units of signals, where a column of words says them."""
    said = next((w for h, w in table.texts.items() if {"unit", "units"} & set(tokens(h))), [])
    if len(said) != table.size:
        return {}
    first = {n: np.flatnonzero(which == k)[0] for k, n in enumerate(names)}
    return {n: u for n, row in first.items() if (u := unit_of(said[row].strip("[]() ")))}


def by_joint(
    table: Table, meanings: Sequence[Meaning], is_signal: Callable[[Meaning], bool]
) -> tuple[Table, tuple[Meaning, ...]] | None:
    """The table with a column for each signal and joint, or None if a row is not of one joint or of
    one robot of several.
    """
    clocks = [m for m in meanings if m.quantity == "time" and m.header in table.columns]
    if not clocks:
        return None
    clock = min(clocks, key=lambda m: m.rank)
    stamps = table.columns[clock.header]
    where, names = _of_robots(table, stamps, *_whose(table))
    if names == [""]:
        return None
    grid, row = np.unique(stamps, return_inverse=True)
    own = {name: np.flatnonzero(where == name) for name in names}
    shared = grid.size < 0.6 * stamps.size
    if not shared:  # joints are asked one after the other: the first one's stamps are the clock
        grid = np.unique(stamps[own[names[0]]])
    columns: dict[str, Array] = {clock.header: grid}
    made: list[Meaning] = [clock]
    signals = [m for m in meanings if is_signal(m) and m.header in table.columns]
    for name in names:  # all joints of a robot stand together
        for m in signals:
            label, rows = f"{m.header} {name}", own[name]
            y = table.columns[m.header][rows]
            if shared:
                columns[label] = np.full(grid.size, math.nan)
                columns[label][row[rows]] = y
            else:
                order = np.argsort(stamps[rows], kind="stable")
                columns[label] = onto(grid, stamps[rows][order], y[order])
            made.append(replace(m, header=label, joint=f"{name} {m.joint}".strip()))
    return replace(table, columns=columns, texts={}), tuple(made)


def _of_robots(
    table: Table, stamps: Array, where: NDArray[np.str_], names: list[str]
) -> tuple[NDArray[np.str_], list[str]]:
    """Each row's joint and all joints, with the robot before the name where rows of several robots
    come at one time: the column that tells those rows apart says it.
    """
    if _alone(stamps, where) > ONCE:
        return where, names
    told = {h: np.array(w) for h, w in table.texts.items() if len(w) == stamps.size}
    whole = {h: y for h, y in table.columns.items() if np.all(y == np.round(y))}
    told |= {h: np.array([f"{n:.0f}" for n in y]) for h, y in whole.items()}
    for header, column in told.items():
        if not set(tokens(header)) & (ROBOTS | WHO) or not 1 < np.unique(column).size <= JOINTS:
            continue
        both = np.char.strip(np.char.add(np.char.add(column, " "), where))
        if _alone(stamps, both) > ONCE:
            return both, list(dict.fromkeys(both.tolist()))
    return where, names


def _alone(stamps: Array, where: NDArray[np.str_]) -> float:
    """Share of rows (n,) that no other one of the same joint has the time of."""
    _, joint = np.unique(where, return_inverse=True)
    return float(len(np.unique(np.column_stack([stamps, joint]), axis=0)) / stamps.size)


def _whose(table: Table) -> tuple[NDArray[np.str_], list[str]]:
    """Each row's joint, and all joints ("" if no row says one); a column of words or of whole
    numbers that keeps changing tells.
    """
    for header, words in table.texts.items():
        names = list(dict.fromkeys(words))
        says = any(w in header.lower() for w in ("joint", "name", "motor", "axis", "servo", "id"))
        if says and 1 < len(names) <= JOINTS and len(names) * 5 <= len(words):
            return np.array(words), names
    for header, column in table.columns.items():
        held = {w for w in tokens(header) if not w.isdigit()}
        if not held or not held <= WHO or not np.isfinite(column).all():
            continue
        numbers = np.unique(column)
        changes = float(np.mean(np.diff(column) != 0)) if column.size > 1 else 0.0
        whole = bool(np.all(numbers == np.round(numbers)))
        if (
            whole
            and 1 < numbers.size <= JOINTS
            and numbers.size * 5 <= column.size
            and changes > 0.2
        ):
            names = [f"{n:.0f}" for n in numbers]
            return np.array([f"{n:.0f}" for n in column]), names
    return np.full(table.size, ""), [""]
