"""One joint's columns into its log: units, position from error, signs, and what is too empty."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pianobot_ros.axis.log import Log
from pianobot_ros.axis.reading.columns.registers import whole
from pianobot_ros.axis.reading.columns.unit_scales import (
    COUNTED,
    angle_scale,
    between,
    by_speed,
    effort_scale,
    speed_scale,
    upside_down,
)
from pianobot_ros.axis.reading.headers.meaning import meaning
from pianobot_ros.axis.reading.headers.unit_words import parts_of
from pianobot_ros.axis.signals.both_sides import at_the_motor, moves_like, why_not
from pianobot_ros.axis.signals.log_repair import (
    HUGE,
    as_read,
    comes_round,
    despiked,
    unwrapped,
)
from pianobot_ros.gap.problem.errors import GapError
from pianobot_ros.gap.problem.types import Array

DISTINCT = 30
"""More whole numbers than that are steps of a converter."""
FEWEST_ON = 100
"""Rows in which a drive must be on, for a flag to say so: of one that is never on nothing would be
left, so it means something else."""
HELD = 0.3
"""rad that a joint may move under what pushes it while its command holds it."""
LEAST = 0.3
"""Share of the rows that a column must fill."""


@dataclass(frozen=True, eq=False)
class Column:
    """A column on the log's clock: y (n,) in `unit`; `sure` if the user declared the unit,
    `guessed` if nobody stated it.
    """

    role: str
    joint: str
    header: str
    table: str
    unit: str
    y: Array
    rank: int = 0
    sure: bool = False
    guessed: bool = False


def joint_log(
    name: str,
    joint: str,
    t: Array,
    columns: Sequence[Column],
    units: Mapping[str, str],
    shared: Sequence[str],
) -> Log:
    """The log of one joint; t (n,) in s. Raises GapError if it has no usable position."""
    label = f"{name} {joint}".strip()
    notes: list[str] = []
    picked = chosen(columns)
    kinds_of = ("position", "motor", "command", "error", "velocity")
    best = {role: picked.get(role) for role in kinds_of}
    effort = picked.get("effort")
    places = {r: _scaled(best[r]) for r in ("position", "command", "error")}
    kinds = {k for y, k in places.values() if y is not None}
    unit = "m" if kinds == {"m"} else "rad"
    command, position = places["command"][0], places["position"][0]
    factor = _by_speed(best, units, position, t, notes)
    command = None if command is None else factor * command
    position = None if position is None else factor * position
    if command is not None and position is not None:
        a, b = _agreed(best, command, despiked(position, "position", []), notes)
        command, position = a * command, b * position
    if position is None:
        position = _from_error(command, places["error"][0], label, notes)
    command = _driving(command, position, unit, notes)
    held = _enabled(picked.get("enable"), t.size, notes)
    if unit == "rad":  # a wrap for one sample is no spike, and a spike hides wraps
        position, command = _round_again(position, command, notes)
    position = despiked(position, "position", notes)
    if unit == "rad":
        position, command = _round_again(position, command, notes)
    position, command = as_read(position, command, t, notes)
    if np.isfinite(position).sum() <= LEAST * t.size:
        raise GapError(
            f"{label}: the position column is (almost) empty; name another with --columns"
            " position=HEADER"
        )
    speed = _speed(best, units, position, t, notes)
    motor, link = _sides(best, position, notes)
    if link is not None and speed is not None and moves_like(speed, link, motor, t):
        speed = None
        notes.append("the velocity is the link's, and so the slope of what is compared already")
    pull, pull_unit = _effort(effort, units, notes)
    heads = ", ".join(f"{c.role} = {c.header}" for c in (*best.values(), effort) if c is not None)
    notes = [f"columns taken: {heads}", *shared, *notes]
    if held is not None and command is not None:
        command = np.where(held, command, math.nan)
    return Log(
        label,
        t - t[0],
        command,
        motor,
        speed,
        pull,
        pull_unit,
        tuple(notes),
        joint,
        unit,
        start=float(t[0]),
        link=link,
    )


def _speed(
    best: Mapping[str, Column | None],
    units: Mapping[str, str],
    position: Array,
    t: Array,
    notes: list[str],
) -> Array | None:
    """Velocity (n,) in SI, as position (n,) at times t (n,) s says; None if there is none."""
    velocity, place = best["velocity"], best["position"] or best["command"]
    if velocity is None or place is None or np.isfinite(velocity.y).mean() <= LEAST:
        return None
    stated, linear = units.get("velocity", velocity.unit), _scaled(place)[1] == "m"
    scale = speed_scale(stated, velocity.y, position, t, linear, notes, place.unit)
    return np.asarray(velocity.y * scale)


def _sides(
    best: Mapping[str, Column | None], position: Array, notes: list[str]
) -> tuple[Array, Array | None]:
    """The motor's position (n,), and the joint's own behind it, where both were recorded and differ
    by a twist; else the joint's position.
    """
    column = best["motor"]
    if column is None or best["position"] is None:
        return position, None
    known = parts_of(column.unit)[1] in COUNTED
    unit = column.unit if known else best["position"].unit  # a ratio of 1 is of angles in one unit
    raw, _ = _scaled(replace(column, unit=unit))
    assert raw is not None
    read = despiked(raw, "motor", [])
    read = unwrapped(read, "motor", [], comes_round(read))
    motor = at_the_motor(read, position)
    if motor is None:
        why = why_not(read, position)
        notes.append(f"{column.header} left out beside the joint's own position: {why}")
        return position, None
    notes.append(
        f"{column.header} is the joint's motor, to which all is referred; {best['position'].header}"
        " behind it shows the twist of what is between"
    )
    return motor, position


def _driving(command: Array | None, position: Array, unit: str, notes: list[str]) -> Array | None:
    """The command (n,), but None if it stays the same throughout and the joint neither is held nor
    comes to rest: whoever drives it uses another command (a speed, a torque).
    """
    if command is None or unit != "rad" or np.unique(command[np.isfinite(command)]).size != 1:
        return command
    x = position[np.isfinite(position)]
    late = float(np.ptp(x[x.size // 2 :])) if x.size > 20 else 0.0
    if late <= max(0.5 * float(np.ptp(x)), HELD):
        return command
    notes.append("the command never changes while the joint moves on: it commands nothing")
    return None


def _round_again(
    wrapped: Array, command: Array | None, notes: list[str]
) -> tuple[Array, Array | None]:
    """Position (n,) without jumps by a turn, or by what its device comes round at, and its command
    within half of that of it.
    """
    period = comes_round(wrapped)
    position = unwrapped(wrapped, "position", notes, period)
    if command is not None and period:
        turns = np.round((position - command) / period)
        command = command + period * np.where(np.isfinite(turns), turns, 0.0)
    return position, command


def chosen(columns: Sequence[Column]) -> dict[str, Column]:
    """The column of each role that a joint's log is made of; "effort" may be a commanded one."""
    roles = ("position", "motor", "command", "error", "velocity", "effort", "enable")
    found = {role: _best(columns, role) for role in roles}
    found["effort"] = found["effort"] or _best(columns, "command effort")
    return {role: column for role, column in found.items() if column is not None}


def _best(columns: Sequence[Column], role: str) -> Column | None:
    own = [c for c in columns if c.role == role and np.isfinite(c.y).mean() > LEAST]
    empty = [c for c in columns if c.role == role]
    if not own:
        return empty[0] if empty and role == "position" else None
    moving = [c for c in own if float(np.nanmax(c.y) - np.nanmin(c.y)) > 0] or own
    return min(moving, key=lambda c: c.rank)


def _scaled(column: Column | None) -> tuple[Array | None, str]:
    if column is None:
        return None, ""
    scale, kind = angle_scale(column.unit or "rad")
    return np.where(np.isfinite(column.y), column.y, math.nan) * scale, kind


def _by_speed(
    best: Mapping[str, Column | None],
    units: Mapping[str, str],
    position: Array | None,
    t: Array,
    notes: list[str],
) -> float:
    """Factor of positions and commands whose unit was guessed, or is none of whole numbers as
    large as theirs, so that the slope of position is the velocity, whose unit was stated.
    """
    places = [c for c in (best["position"], best["command"]) if c is not None]
    velocity = best["velocity"]
    if velocity is None or position is None or not places:
        return 1.0
    if not all(c.guessed for c in places) and not _increments(places, position):
        return 1.0
    stated = units.get("velocity", velocity.unit)
    factor = by_speed(stated, velocity.y, position, t)
    if not math.isfinite(factor) or abs(math.log(factor)) < 0.1:
        return 1.0
    notes.append(
        f"positions multiplied by {factor:.4g}, so that their slope is the velocity in {stated}"
    )
    return factor


def _increments(places: Sequence[Column], position: Array) -> bool:
    """Whether positions are increments, whatever their headers state: whole numbers that would be
    no joint's in that unit; position (n,) is in it.
    """
    if any(c.sure or not whole(c.y) for c in places):
        return False
    return float(np.nanmax(np.abs(position), initial=0.0)) > HUGE


def _agreed(
    best: Mapping[str, Column | None], command: Array, position: Array, notes: list[str]
) -> tuple[float, float]:
    """Factors that bring a command (n,) to the unit and the sign of its position (n,), and both to
    one unit.
    """
    columns = best["position"], best["command"]
    sure = all(c is not None and c.sure for c in columns)
    a, b = (1.0, 1.0) if sure else between(command, position, notes)
    if not upside_down(a * command, b * position):
        return a, b
    notes.append("the position counts against its command, which is taken with the other sign")
    return -a, b


def _from_error(command: Array | None, error: Array | None, label: str, notes: list[str]) -> Array:
    """Position from command and following error; a joint lags, so the error's sign can be told."""
    if command is None or error is None:
        raise GapError(
            f"{label}: no column of positions; say --columns position=HEADER, or error=HEADER"
            " beside a command"
        )
    ok = np.isfinite(command) & np.isfinite(error)
    ahead = float(np.sum(np.gradient(command[ok]) * (error[ok] - error[ok].mean())))
    sign = -1.0 if ahead < 0 else 1.0
    how = "minus" if sign > 0 else "plus"
    notes.append(f"position taken as command {how} error, so that the joint lags")
    return np.asarray(command - sign * error)


def _of_a_register(column: Column) -> bool:
    """Whether an effort is in a servo's own steps: whole numbers of no stated unit."""
    distinct = np.unique(column.y[np.isfinite(column.y)]).size
    return column.guessed and distinct > DISTINCT and whole(column.y)


def _enabled(column: Column | None, n: int, notes: list[str]) -> Array | None:
    if column is None:
        return None
    on = np.nan_to_num(column.y, nan=1.0) > 0.5
    if on.all() or np.count_nonzero(on) < FEWEST_ON or column.y.size != n:
        return None
    notes.append(f"the drive is off in {100 * (1 - on.mean()):.0f} % of the rows ({column.header})")
    return np.asarray(on)


def _effort(
    column: Column | None, units: Mapping[str, str], notes: list[str]
) -> tuple[Array | None, str]:
    if column is None:
        return None, ""
    unit = units.get("effort") or column.unit
    guessed = column.guessed and not units.get("effort")
    if guessed and _of_a_register(column):
        notes.append(
            f"effort ({column.header}) holds whole numbers of no stated unit; its scale is fitted"
        )
        unit = "counts"
    elif guessed:
        called = column.header if meaning(column.header).quantity == "effort" else column.table
        notes.append(f"effort taken as {unit}, as {called} is called; --units effort=… says else")
    factor, name = effort_scale(unit)
    if not name:
        notes.append(f"effort ({column.header}) has no unit; its scale is fitted")
        name = "effort"
    if column.role == "command effort":
        notes.append(
            f"effort is what was commanded or calculated ({column.header}), not what was measured"
        )
    return np.where(np.isfinite(column.y), column.y, math.nan) * factor, name
