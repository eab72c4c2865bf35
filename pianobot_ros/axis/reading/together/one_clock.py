"""The signals of the tables of a run on one clock."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.axis.reading.columns.assemble import Column
from pianobot_ros.axis.reading.columns.clock import onto, ordered, time_of
from pianobot_ros.axis.reading.columns.matching import SIGNALS, joints_of
from pianobot_ros.axis.reading.formats.table import FEWEST, Table
from pianobot_ros.axis.reading.headers.meaning import states
from pianobot_ros.axis.reading.headers.record import Meaning
from pianobot_ros.axis.reading.headers.vocabulary import OTHER
from pianobot_ros.axis.reading.headers.words import tokens
from pianobot_ros.axis.reading.request import Request
from pianobot_ros.axis.reading.source import Source, still
from pianobot_ros.gap.problem.errors import GapError
from pianobot_ros.gap.problem.types import Array

Rows: TypeAlias = NDArray[np.intp]
FULL = 0.9
"""Share of the rows from which on a column counts as filled."""


def main_of(sources: Sequence[Source]) -> Source:
    """The table whose clock counts: the one with the most measured positions; of two with as many
    signals that which states their unit.
    """

    def worth(s: Source) -> tuple[int, int, int, int]:
        roles = [m.role for m in s.meanings]
        stated = sum(m.role == "position" and bool(m.unit) for m in s.meanings)
        driven = roles.count("error") + roles.count("effort")
        return roles.count("position"), driven, stated, s.table.size

    return max(sources, key=worth)


def clock_of(main: Source, request: Request, notes: list[str]) -> tuple[Rows, Array, str]:
    """Which rows of the main table count, their times (n,) s, and the header of its clock. Raises
    GapError for too few.
    """
    if main.table.size < FEWEST:
        raise GapError(
            f"{main.table.path.name}: only {main.table.size} row(s); a log needs at least {FEWEST}"
        )
    stamps, header, _ = time_of(
        main.table, main.meanings, request.units.get("time", ""), request.rate, notes
    )
    placed = [
        main.table.columns[m.header]
        for m in main.meanings
        if m.role == "position" and m.header in main.table.columns
    ]
    if placed:  # rows that only other signals have (a merged export) give no grid
        shown = _shown([np.isfinite(p) for p in placed])
        stamps = stamps if shown is None else np.where(shown, stamps, math.nan)
    rows, t = ordered(stamps, notes)
    if t.size < FEWEST:
        raise GapError(
            f"{main.table.path.name}: only {t.size} rows with different time stamps in {header};"
            f" at least {FEWEST} are needed (--columns time=HEADER names another)"
        )
    return rows, t, header


def _shown(known: Sequence[NDArray[np.bool_]]) -> NDArray[np.bool_] | None:
    """Rows (n,) that hold the positions of joints, of which `known` says where each has one; None
    if all count. Of positions that stand in rows of their own, as several programs wrote them in
    turn, those count that fill most rows.
    """
    fullest = max(known, key=np.count_nonzero)
    in_turn = [k for k in known if k.any() and not np.any(k & fullest)]
    if in_turn:
        return fullest
    shown = np.any(known, axis=0)
    return shown if float(np.mean(shown)) < FULL and _sparse(shown) else None


def _sparse(shown: Array) -> bool:
    """Whether a column is filled now and then throughout, rather than missing for a while."""
    at = np.flatnonzero(shown)
    return at.size > 20 and float(np.median(np.diff(at))) > 1.0


def columns_on(
    source: Source,
    main: Source,
    rows: Rows,
    t: Array,
    request: Request,
    notes: list[str],
    have: Sequence[Column],
) -> list[Column]:
    """Signals of one table on the main clock, without those that are there already."""
    kept = [m for m in source.meanings if m.role in SIGNALS and m.header in source.table.columns]
    if source is not main:
        joints = joints_of(have)
        taken = {(c.role, c.joint) for c in have if c.joint in joints}  # not places in arrays
        kept = [m for m in kept if (m.role, m.joint) not in taken]
        theirs = {m.joint for m in kept if m.role == "position"}
        there = {c.role for c in have}
        further = {"position", "command"} <= {m.role for m in kept} & there  # joints of their own
        if len(theirs) == len(joints) and not further:  # the same joints by other names
            kept = [m for m in kept if m.role not in there]
    places = [source.table.columns[m.header] for m in kept if m.role == "position"]
    if places and not any(map(still, places)):  # what stands still is no velocity of what moves
        kept = [
            m for m in kept if m.role != "velocity" or not still(source.table.columns[m.header])
        ]
    kept += _unnamed(source)
    if not kept:
        return []
    made = []
    if source is main:
        whole = source.table.columns
        stamps = None
    else:
        declared = request.units.get("time", "")
        own, clock, _ = time_of(source.table, source.meanings, declared, request.rate, notes)
        kept = [m for m in kept if m.header != clock]
        order, stamps = ordered(own, notes)
        stamps = _aligned(stamps, t, source.table.path.name, notes)
        whole = {m.header: source.table.columns[m.header][order] for m in kept}
    for m in kept:
        y = whole[m.header]
        if stamps is not None:
            placed = onto(t, stamps, y)
        else:
            here = y[rows]
            sparse = not np.all(np.isfinite(here)) and np.isfinite(here).mean() < FULL
            placed = _filled(main, m, rows, t, request) if sparse else here
        made.append(_column(m, source.table, placed))
    return made


def _column(m: Meaning, table: Table, y: Array) -> Column:
    """A column's numbers (n,) with what it means; an effort's unit may be that of its name only."""
    stated = m.header in table.units or states(m.header, m.unit)
    guessed = m.quantity == "effort" and bool(m.unit) and not stated
    return Column(m.role, m.joint, m.header, table.name, m.unit, y, m.rank, guessed=guessed)


def _unnamed(source: Source) -> list[Meaning]:
    """Columns of numbers that no word says anything of."""
    return [
        m
        for m in source.meanings
        if m.quantity == "other" and not m.command and not set(tokens(m.header)) & OTHER
        if m.header in source.table.columns and not still(source.table.columns[m.header])
    ]


def _filled(main: Source, m: Meaning, rows: Rows, t: Array, request: Request) -> Array:
    """A column that is filled now and then, between its own samples."""
    y = main.table.columns[m.header]
    known = np.isfinite(y)
    if not _sparse(known[rows]) and np.isfinite(y[rows]).mean() > 0.05:
        return np.asarray(y[rows])
    notes: list[str] = []
    declared, rate = request.units.get("time", ""), request.rate or 1.0
    stamps, _, _ = time_of(main.table, main.meanings, declared, rate, notes)
    both = known & np.isfinite(stamps)
    order = np.argsort(stamps[both], kind="stable")
    return onto(t, stamps[both][order], y[both][order])


def _aligned(stamps: Array, t: Array, name: str, notes: list[str]) -> Array:
    """Stamps of another file on the main clock: as they are if the two overlap, else from the same
    start.
    """
    shared = min(stamps[-1], t[-1]) - max(stamps[0], t[0])
    if shared > 0.5 * min(np.ptp(stamps), np.ptp(t)):
        return stamps
    notes.append(
        f"{name} has another clock ({stamps[0]:.6g} s against {t[0]:.6g} s at the start); both were"
        " set to start together, so a constant delay between the two says nothing"
    )
    return np.asarray(stamps - stamps[0] + t[0])
