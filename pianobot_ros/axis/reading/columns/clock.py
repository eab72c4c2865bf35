"""Time stamps as they come: seconds to nanoseconds, dates, two columns, none, coarse, unsorted."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.axis.reading.formats.table import Table, some_of
from pianobot_ros.axis.reading.headers.record import Meaning
from pianobot_ros.axis.reading.headers.unit_words import SECONDS, parts_of
from pianobot_ros.axis.reading.headers.vocabulary import LETTER
from pianobot_ros.axis.reading.headers.words import tokens
from pianobot_ros.axis.signals.log_repair import astray, in_order
from pianobot_ros.gap.problem.errors import GapError
from pianobot_ros.gap.problem.types import Array

SCALES = {**SECONDS, "min": 60.0, "h": 3600.0, "d": 86_400.0, "µd": 0.0864}
"""Seconds in a unit of stamps: spreadsheets count days, and WinCC's `Time_ms` their millionths."""
DAYS = (2e4, 8e4)
"""Days since 1900 of dates between 1954 and 2119."""
EPOCH = (1e8, 4e9)
"""Seconds since 1970 of dates between 1973 and 2096."""
APART = (0.01, 3.0)
"""Logarithms of how many times longer one clock is than another from which they disagree, and from
which one of them is no clock of this log."""
EVEN = 1e-3
"""Spread of a clock's steps over their mean below which nobody measured it."""
HALF = 0.5
"""Seconds over which the rest of whole seconds varies, at least: how long a cycle took does not."""
FEWEST = 10
"""Stamps that two clocks must have in common."""


def time_of(
    table: Table, meanings: Sequence[Meaning], declared: str, rate: float, notes: list[str]
) -> tuple[Array, str, str]:
    """Stamps (n,) in s, their header, and their unit; NaN where a row has none.

    Raises GapError if the table has neither stamps nor a rate.
    """
    named = [m for m in meanings if m.quantity == "time" and m.header in table.columns]
    if two := _in_two(table, named):
        whole, rest = two
        t = table.columns[whole.header] + SECONDS[rest.unit] * table.columns[rest.header]
        return t, f"{whole.header} + {rest.header}", "s"
    usable = [m for m in named if _stamps(table.columns[m.header])]
    usable = usable or [m for m in named if _stamps(table.columns[m.header][::-1])]  # newest first
    usable = [m for m in usable if not _lasts(m, table.columns[m.header])]
    if not usable and not (rate or table.rate):
        usable = _by_shape(table, meanings, notes)
    if not usable:
        hertz = (rate or table.rate) / table.group
        if not hertz:
            stuck = next((m.header for m in named if _stands(table.columns[m.header])), "")
            why = f"{stuck} never changes" if stuck else "no column of time stamps"
            raise GapError(
                f"{table.path.name}: {why}; say --columns time=HEADER, or"
                f" --rate HZ (columns: {some_of(table.columns)})"
            )
        notes.append(f"no time stamps; rows taken as {hertz:g} Hz")
        return np.arange(table.size) / hertz, "(rate)", "s"
    chosen = min(usable, key=lambda m: m.rank)
    if not declared:
        chosen = _measured(table, chosen, usable, notes)
    y = table.columns[chosen.header]
    unit = declared or chosen.unit or table.units.get(chosen.header, "")
    if not declared and _dates(y, 1e6):
        unit = "µd"
    if _seconds(unit) and not declared and not _plausible(y, _seconds(unit)):
        notes.append(f"{chosen.header} is called {unit}, which its steps contradict")
        unit = ""
    if not _seconds(unit):
        unit = _guessed(y)
        if unit != "s":
            notes.append(f"time stamps taken as {unit} (typical step {_step(y):g})")
    return y * _seconds(unit), chosen.header, unit


def _in_two(table: Table, named: Sequence[Meaning]) -> tuple[Meaning, Meaning] | None:
    """Columns of whole seconds and of the rest of them in a smaller unit, as operating systems keep
    a time; the rest uses all of a second.
    """
    first: dict[str, Meaning] = {}
    for m in named:
        first.setdefault(m.unit, m)
    whole = first.get("s")
    if whole is None or not _whole(table.columns[whole.header]):
        return None
    for unit in ("ns", "us", "ms"):
        rest = first.get(unit)
        share = SECONDS[unit] * table.columns[rest.header] if rest else np.zeros(1)
        low, high = float(np.nanmin(share)), float(np.nanmax(share))
        if rest and low >= 0.0 and high < 1.001 and (unit == "ns" or high - low > HALF):
            return whole, rest
    return None


def _seconds(unit: str) -> float:
    """Seconds in a unit of time, or in a number of them (`10/ms`); 0 if it is none."""
    part, whole = parts_of(unit)
    return part * SCALES.get(whole, 0.0)


def _measured(
    table: Table, chosen: Meaning, usable: Sequence[Meaning], notes: list[str]
) -> Meaning:
    """Of two clocks that run at different speeds the one whose steps vary, as measured ones do: a
    counter of loops times what a loop should take is as even as no computer's loop is.
    """
    for other in usable:
        both = [table.columns[m.header] for m in (chosen, other)]
        known = np.isfinite(both[0]) & np.isfinite(both[1])
        if other is chosen or known.sum() < FEWEST:
            continue
        lasting = [float(np.ptp(x[known])) * SCALES.get(_guessed(x), 1.0) for x in both]
        if min(lasting) <= 0.0 or not (
            APART[0] < abs(math.log(lasting[0] / lasting[1])) < APART[1]
        ):
            continue
        steps = [np.diff(x[known]) for x in both]
        uneven = [float(np.std(x) / np.mean(x)) for x in steps]
        taken = other if uneven[0] < EVEN < uneven[1] else chosen
        notes.append(
            f"{chosen.header} is {lasting[0]:.4g} s long and {other.header} {lasting[1]:.4g} s;"
            f" {taken.header} is taken (--columns time=HEADER takes another)"
        )
        return taken
    return chosen


def ordered(t: Array, notes: list[str]) -> tuple[NDArray[np.intp], Array]:
    """Rows in the order of time (indices) and their stamps (n,) in s, strictly rising.

    Damaged stamps are left out, resets of the clock undone, coarse stamps spread evenly.
    """
    good = np.flatnonzero(np.isfinite(t))
    good = good[~astray(t[good])]
    if good.size < 2:
        return good, t[good]
    spread = _spread(t[good], notes)
    fixed = in_order(spread, notes)
    order = np.argsort(fixed, kind="stable")
    late = int(np.sum(np.diff(fixed) < 0))
    if late:
        notes.append(f"rows were not in the order of time at {late} place(s); sorted")
    stamps, first = np.unique(fixed[order], return_index=True)
    apart = np.diff(stamps - stamps[0], prepend=-1.0) > 0  # as a log counts them: from its first
    return good[order][first][apart], stamps[apart]


def _by_shape(table: Table, meanings: Sequence[Meaning], notes: list[str]) -> list[Meaning]:
    """The column that rises in even steps as only a clock does, where none is called time."""
    for m in meanings:
        y = table.columns.get(m.header)
        unnamed = m.role == "other" or m.rank >= LETTER or table.headless
        unnamed = unnamed and m.rank >= 0  # the user did not say what it is
        if y is None or not unnamed or np.isfinite(y).mean() < 0.99:  # a last row may say "end"
            continue
        step = np.diff(y[np.isfinite(y)])
        if step.size < 10 or np.mean(step > 0) < 0.99 or (_whole(y) and np.all(step == 1)):
            continue
        low, middle, high = np.quantile(step, [0.1, 0.5, 0.9])
        if high - low < 0.5 * middle:
            notes.append(f"no column is called time; {m.header} rises evenly and is taken as it")
            return [m]
    return []


def _whole(y: Array) -> bool:
    known = y[np.isfinite(y)]
    return known.size > 0 and bool(np.all(known == np.round(known)))


def _stamps(y: Array) -> bool:
    known = y[np.isfinite(y)]
    return known.size > 2 and float(np.ptp(known)) > 0 and float(np.mean(np.diff(known) >= 0)) > 0.4


def _lasts(m: Meaning, y: Array) -> bool:
    """Whether a column says how long something took, and not since when."""
    return "duration" in tokens(m.header) and bool(np.any(np.diff(y[np.isfinite(y)]) < 0))


def _stands(y: Array) -> bool:
    """Whether a column has one number throughout."""
    known = y[np.isfinite(y)]
    return known.size > 1 and float(np.ptp(known)) == 0.0


def _step(y: Array) -> float:
    step = np.diff(np.sort(y[np.isfinite(y)]))  # rows may be out of order
    step = step[step > 0]
    return float(np.median(step)) if step.size else 1.0


def _plausible(y: Array, scale: float) -> bool:
    return 1e-5 <= _step(y) * scale <= 3.0


def _guessed(y: Array) -> str:
    size = float(np.median(np.abs(y[np.isfinite(y)])))
    for unit, scale in SECONDS.items():
        if EPOCH[0] <= size * scale <= EPOCH[1] and _plausible(y, scale):
            return unit
    step = _step(y)
    if _dates(y, 1.0) and step < 1e-3 and _plausible(y, SCALES["d"]):
        return "d"
    if step <= 0.5:
        return "s"
    return "ms" if step <= 1000.0 else ("us" if step <= 5e5 else "ns")


def _dates(y: Array, scale: float) -> bool:
    """Whether stamps (n,) are days since 1900 times a scale."""
    size = float(np.median(np.abs(y[np.isfinite(y)])))
    return DAYS[0] * scale <= size <= DAYS[1] * scale


def _spread(t: Array, notes: list[str]) -> Array:
    """Stamps that many rows share (whole seconds, say), spread evenly between one and the next."""
    change = np.flatnonzero(np.diff(t) != 0) + 1
    if t.size < 20 or change.size + 1 > 0.7 * t.size or change.size < 3:
        return t
    first = np.concatenate([[0], change])
    length = np.diff(np.concatenate([first, [t.size]]))
    if float(np.std(length[1:-1])) > 0.6 * float(np.mean(length)):
        return t  # no coarse clock but a signal that was logged again and again
    ends = np.append(t[first], t[first[-1]] + float(np.median(np.diff(t[first]))))
    notes.append(
        f"time stamps are coarse ({float(np.mean(length)):.0f} rows share one); spread evenly"
    )
    index = np.concatenate([first, [t.size]]).astype(float)
    if length.size > 3:  # the first stamp may have been joined late
        typical = float(np.median(length))
        index[0] = min(0.0, first[1] - typical)
    fine = np.interp(np.arange(t.size, dtype=float), index, ends)
    even = _even(fine)
    coarse = float(np.median(np.diff(t[first])))
    return even if float(np.max(np.abs(even - fine))) < coarse else np.asarray(fine)


def _even(t: Array) -> Array:
    """The straight line through times (n,)."""
    at = np.arange(t.size) - 0.5 * (t.size - 1)
    return np.asarray(t.mean() + at * float(at @ (t - t.mean())) / float(at @ at))


def onto(t: Array, ts: Array, y: Array) -> Array:
    """Samples (ts, y) at times t (n,), linear between; NaN in their holes and beyond their ends."""
    known = np.isfinite(y) & np.isfinite(ts)
    x, z = ts[known], y[known]
    if x.size < 2:
        return np.full(t.size, math.nan)
    step = float(np.median(np.diff(x)))
    out = np.interp(t, x, z)
    right = np.clip(np.searchsorted(x, t), 1, x.size - 1)
    wide = x[right] - x[right - 1] > 6.0 * step + 1e-9
    near = np.minimum(np.abs(t - x[right]), np.abs(t - x[right - 1])) <= 0.5 * step
    out[(wide & ~near) | (t < x[0] - 2.0 * step) | (t > x[-1] + 2.0 * step)] = math.nan
    return np.asarray(out)
