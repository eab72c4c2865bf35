"""Which of a recording's topics tell of joints, where some of its messages name these."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pianobot_ros.axis.reading.columns.clock import onto, time_of
from pianobot_ros.axis.reading.columns.matching import SIGNALS
from pianobot_ros.axis.reading.columns.relations import unwound
from pianobot_ros.axis.reading.formats.table import FEWEST, Table, some_of
from pianobot_ros.axis.reading.headers.meaning import meaning
from pianobot_ros.axis.reading.headers.record import Meaning
from pianobot_ros.axis.reading.headers.vocabulary import BARE, FOREIGN
from pianobot_ros.axis.reading.source import Source
from pianobot_ros.gap.problem.types import Array

__all__ = ["told_of_joints"]

SAME, APART = 1e-3, 10.0
"""Share of the variance of a joint's motion that another reading of it leaves at most, and how many
times as much the next joint's leaves."""
DRIVES = {"effort", "command effort", "command", "error"}
NOT_CLEAR, CALLED = (False, False), (False, True)


def told_of_joints(sources: Sequence[Source]) -> list[Source]:
    """Topics of one recording, in which only what says most clearly that it is a joint's position
    is one: where messages name joints, no other numbers are (a pressure that was `measured`, a
    key's angle); where messages have what drives joints beside positions, no array is that has
    nothing beside it (a body's place); unless it is of more joints than these (an arm's array
    beside its named fingers). Where any are called positions, none is that only a word like "state"
    tells of.

    What stands at one place of an array with such a position is of the joint that moves like it, or
    of none.
    """
    clearest = max((_clear(m, s.table) for s in sources for m in _places(s)), default=NOT_CLEAR)
    if clearest == NOT_CLEAR or not all(s.table.of_one_run for s in sources):
        return list(sources)
    named = [s for s in sources if clearest[0] and _places(s, clearest)]
    driven = [s for s in sources if _driven(s, clearest)]
    most = max(map(_most, named or driven), default=0)
    out: list[Source] = []
    left: list[str] = []
    vague = any(_places(s) and not _places(s, clearest) for s in sources)
    known = _motions(named if vague else (), clearest)
    for s in sources:
        kept = {m.header for m in _places(s, clearest)}
        if most and _most(s) > most:
            kept = {m.header for m in _places(s, CALLED)}
        elif driven and not named and not _driven(s, clearest):
            kept -= {h for h in kept if "[" in h}
        of = {} if kept else _by_motion(s, known)
        beside = not kept and bool(_places(s, CALLED))  # what is no joint's, or of those in `of`
        made = []
        for m in s.meanings:
            vague = m.role == "position" and m.header not in kept
            strange = beside and m.role in SIGNALS and m.joint not in of
            if vague and m.joint not in of and meaning(m.header).role == "position":
                left.append(f"{s.table.name}: {m.header}")
            told = replace(m, quantity=FOREIGN, command=False) if vague or strange else m
            made.append(replace(told, joint=of.get(m.joint, m.joint)))
        out.append(replace(s, meanings=tuple(made)))
    return _noted(out, left, bool(named))


def _driven(source: Source, least: tuple[bool, bool]) -> bool:
    """Whether a source has positions as clear as that, and what drives joints beside them."""
    return bool(_places(source, least)) and bool(source.roles() & DRIVES)


def _most(source: Source) -> int:
    """Joints of the largest group of positions of a source, whose headers differ by a number or, in
    messages that name them, a name.
    """
    groups: dict[str, set[str]] = {}
    for m in _places(source, CALLED):
        group = "" if m.header in source.table.owners else re.sub(r"\d+", "", m.header)
        groups.setdefault(group, set()).add(m.joint)
    return max(map(len, groups.values()), default=0)


def _clear(m: Meaning, table: Table) -> tuple[bool, bool]:
    """Whether a message names the joint of a position, and whether that is called a position."""
    return m.header in table.owners or m.joint in table.joints, m.rank < BARE


def _places(source: Source, least: tuple[bool, bool] = NOT_CLEAR) -> list[Meaning]:
    """The positions of a source that are as clearly a joint's as that."""
    own = (m for m in source.meanings if m.role == "position")
    return [m for m in own if _clear(m, source.table) >= least]


def _motions(
    named: Sequence[Source], clearest: tuple[bool, bool]
) -> dict[str, tuple[Array, Array]]:
    """Stamps (n,) and positions (n,) of each joint that messages name."""
    known: dict[str, tuple[Array, Array]] = {}
    for s in named:
        clock = _clock(s)
        for m in _places(s, clearest):
            known.setdefault(m.joint, (clock, s.table.columns[m.header]))
    return known


def _by_motion(source: Source, known: Mapping[str, tuple[Array, Array]]) -> dict[str, str]:
    """The joint of those `known` by their motions that moves like each of a source's, {} if it has
    no positions. What moves like none, or like two, is not among them.
    """
    places = _places(source) if known else []
    of: dict[str, str] = {}
    t = _clock(source) if places else np.zeros(0)
    for m in places:
        q = source.table.columns[m.header]
        apart = sorted((_unlike(t, q, *other), joint) for joint, other in known.items())
        clear = apart[0][0] < SAME and (len(apart) == 1 or APART * apart[0][0] < apart[1][0])
        if clear and apart[0][1] not in of.values():
            of.setdefault(m.joint, apart[0][1])
    return of


def _clock(source: Source) -> Array:
    """Stamps (n,) of a source in s, or its rows' numbers if it has none."""
    return time_of(source.table, source.meanings, "", 1.0, [])[0]


def _unlike(t: Array, q: Array, ts: Array, other: Array) -> float:
    """1 less the squared correlation of two positions (n,) and (k,), at times t and ts, each in
    whatever unit; 1 if unknown.
    """
    order = np.argsort(ts, kind="stable")
    y = onto(t, ts[order], other[order])
    ok = np.isfinite(q) & np.isfinite(y)
    if ok.sum() < FEWEST:
        return 1.0
    one, two = unwound(q[ok], y[ok])
    return 1.0 - float(np.corrcoef(one, two)[0, 1]) ** 2 if np.ptp(one) * np.ptp(two) > 0 else 1.0


def _noted(sources: list[Source], left: Sequence[str], named: bool) -> list[Source]:
    """The sources with a note on what is no position of a joint."""
    if not left:
        return sources
    why = "messages name the joints" if named else "others are clearly joints'"
    said = f"{some_of(left, 3)}: no joint's position, as {why} (--columns position=HEADER takes it)"
    first = sources[0].table
    return [replace(sources[0], table=replace(first, notes=(*first.notes, said))), *sources[1:]]
