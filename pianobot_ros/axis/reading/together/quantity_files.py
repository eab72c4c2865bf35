"""Which tables are of one run where only their names tell: a file for each quantity, topics of
several robots.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np

from pianobot_ros.axis.reading.columns.clock import onto
from pianobot_ros.axis.reading.columns.matching import SIGNALS
from pianobot_ros.axis.reading.columns.relations import LEFT, left_over
from pianobot_ros.axis.reading.formats.table import Table
from pianobot_ros.axis.reading.headers.meaning import meaning
from pianobot_ros.axis.reading.headers.stems import stem_key, stem_says
from pianobot_ros.axis.reading.source import Source
from pianobot_ros.gap.problem.errors import GapError
from pianobot_ros.gap.problem.types import Array

__all__ = ["beside_each_other", "nameless", "of_robots", "together"]

UNEVEN = 0.01
"""Share of rows by which files without time stamps may differ, as one was closed a little later."""


def together(groups: Sequence[Sequence[Table]]) -> list[list[Table]]:
    """Groups of tables; those of one folder that are a table each are one where their names tell
    different quantities of it, positions among them, and they have as many rows and one clock.
    """
    of: dict[tuple[Path, int, tuple[str, ...]], list[list[Table]]] = {}
    out: list[list[Table]] = []
    for group in map(list, groups):
        (first, *others) = group
        if others or not stem_says(first.name)[0] or not nameless(first):
            out.append(group)
            continue
        runs = tuple(w for w in stem_key(first.name) if any(map(str.isdigit, w)))
        of.setdefault((first.path.parent.resolve(), first.size, runs), []).append(group)
    for held in of.values():
        tables = [t for (t,) in held]
        said = [stem_says(t.name) for t in tables]
        one = len(set(said)) == len(said) and ("position", False) in said
        out += [tables] if one and _one_clock(tables) else held
    return _with_commands(out)


def _with_commands(groups: list[list[Table]]) -> list[list[Table]]:
    """Groups of tables; where a folder gives one of commands and one of what was measured, whatever
    else their names say, they are one run, unless either is whole by itself.
    """
    of: dict[Path, list[list[Table]]] = {}
    for group in groups:
        of.setdefault(group[0].path.parent.resolve(), []).append(group)
    out: list[list[Table]] = []
    for held in of.values():
        tables = [t for g in held for t in g]
        wanted = [t for t in tables if stem_says(t.name)[1]]
        pair = len(held) == len(tables) == 2 and len(wanted) == 1 and not any(map(_whole, tables))
        out += [tables] if pair else held
    return out


def _whole(table: Table) -> bool:
    """Whether a table has commanded and measured positions."""
    return {"command", "position"} <= {meaning(h).role for h in table.columns}


def nameless(table: Table) -> bool:
    """Whether no header of a table says what it is, a clock apart."""
    return not any(meaning(h).role in SIGNALS for h in table.columns)


def beside_each_other(tables: Sequence[Table]) -> None:
    """Raises GapError if tables without headers and time stamps are not of as many rows."""
    bare = [t for t in tables if nameless(t) and _clock(t) is None and not t.rate]
    if len(bare) < 2:
        return
    first = bare[0]
    for other in bare[1:]:
        if abs(other.size - first.size) <= UNEVEN * max(other.size, first.size):
            continue
        if other.path == first.path:
            raise GapError(
                f"{first.path.name} holds arrays of {first.size} and of {other.size} rows, and"
                " nothing tells when any of them were; save those of one run, with a column of"
                " time, in a file of their own"
            )
        raise GapError(
            f"{first.path.name} has {first.size} rows and {other.path.name} {other.size}, and"
            " neither has time stamps, so they cannot be laid beside each other; give the files"
            " of one run, with as many rows or a column of time"
        )


def _one_clock(tables: Sequence[Table]) -> bool:
    first, *others = (_clock(t) for t in tables)
    return all(
        np.array_equal(first, c) if first is not None and c is not None else first is c
        for c in others
    )


def _clock(table: Table) -> Array | None:
    return next((c for h, c in table.columns.items() if meaning(h).role == "time"), None)


def of_robots(sources: Sequence[Source]) -> list[list[Source]]:
    """Topics of one recording by robot: where a topic comes again in another namespace with the
    positions of joints of the same names, and these move otherwise or each have commands of their
    own beside them, each namespace is a robot's. A topic in none of them is everybody's.
    """
    placed = [s for s in sources if s.table.of_one_run and "position" in s.roles()]
    told = {_space(s) for s in sources if s.table.of_one_run and _commands(s)}
    read = {_space(s) for s in placed if not _commands(s)}
    spaces = _spaces([s for s in placed if not _commands(s) or _space(s) not in read], told & read)
    if not spaces:
        return [list(sources)]
    out = []
    for space in spaces:
        others = [f"{o}/" for o in spaces if o != space]
        own = [s for s in sources if not s.table.name.startswith(tuple(others))]
        out.append([replace(s, table=replace(s.table, robot=space)) for s in own])
    return out


def _space(source: Source) -> str:
    """The namespace that a topic is in."""
    return source.table.name.partition("/")[0]


def _commands(source: Source) -> bool:
    """Whether a topic holds commanded positions."""
    return "command" in source.roles() or stem_says(source.table.name)[1]


def _spaces(sources: Sequence[Source], commanded: Collection[str]) -> list[str]:
    """Namespaces of robots, [] if there are not several; `commanded` are those that hold commands
    beside what was measured.
    """
    of: dict[str, dict[str, Source]] = {}
    for s in sources:
        space, _, topic = s.table.name.partition("/")
        of.setdefault(topic, {})[space] = s
    for topic, own in of.items():
        joints = {
            frozenset(m.joint for m in s.meanings if m.role == "position") for s in own.values()
        }
        if not topic or len(own) < 2 or len(joints) > 1:
            continue
        # where two hold one motion, one is a command of it, say, or its filtered copy
        if own.keys() <= set(commanded) or not any(
            _alike(one, other) for one, other in combinations(own.values(), 2)
        ):
            return list(own)
    return []


def _alike(one: Source, other: Source) -> bool:
    """Whether most positions of a source follow those of the joints so called in another."""
    clocks = [_clock(s.table) for s in (one, other)]
    if clocks[0] is None or clocks[1] is None:
        return True
    theirs = {m.joint: m.header for m in other.meanings if m.role == "position"}
    left = [
        left_over(
            one.table.columns[m.header],
            onto(clocks[0], clocks[1], other.table.columns[theirs[m.joint]]),
        )
        for m in one.meanings
        if m.role == "position"
    ]
    return float(np.median(left)) < LEFT
