"""Tables with a row for each joint and time, as tables with columns for each joint."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.axis.reading.columns.clock import onto
from pianobot_ros.axis.reading.formats.table import JOINTS, Table
from pianobot_ros.axis.reading.names import Meaning, tokens
from pianobot_ros.gap.problem.types import Array

WHO = {"joint", "joints", "name", "names", "motor", "motors", "axis", "axes", "servo", "id"}
WHO |= {"device", "node"}
"""Words of a header that says whose a row is."""


def by_joint(
    table: Table, meanings: Sequence[Meaning], is_signal: Callable[[Meaning], bool]
) -> tuple[Table, tuple[Meaning, ...]] | None:
    """The table with a column for each signal and joint, or None if a row is not of one joint."""
    clocks = [m for m in meanings if m.quantity == "time" and m.header in table.columns]
    if not clocks:
        return None
    clock = min(clocks, key=lambda m: m.rank)
    whose = _whose(table)
    if whose is None:
        return None
    where, names = whose
    stamps = table.columns[clock.header]
    grid, row = np.unique(stamps, return_inverse=True)
    own = {name: np.flatnonzero(where == name) for name in names}
    shared = grid.size < 0.6 * stamps.size
    if not shared:  # joints are asked one after the other: the first one's stamps are the clock
        grid = np.unique(stamps[own[names[0]]])
    columns: dict[str, Array] = {clock.header: grid}
    made: list[Meaning] = [clock]
    for m in meanings:
        if not is_signal(m) or m.header not in table.columns:
            continue
        for name in names:
            label, rows = f"{m.header} {name}", own[name]
            y = table.columns[m.header][rows]
            if shared:
                columns[label] = np.full(grid.size, math.nan)
                columns[label][row[rows]] = y
            else:
                order = np.argsort(stamps[rows], kind="stable")
                columns[label] = onto(grid, stamps[rows][order], y[order])
            made.append(replace(m, header=label, joint=name))
    return replace(table, columns=columns, texts={}), tuple(made)


def _whose(table: Table) -> tuple[NDArray[np.str_], list[str]] | None:
    """Each row's joint, and all joints; a column of words or of whole numbers that keeps changing
    tells.
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
    return None
