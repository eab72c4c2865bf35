"""Units of positions and commands, as stated, as of the others, or guessed from all of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pianobot_ros.axis.reading.columns.assemble import Column, chosen
from pianobot_ros.axis.reading.columns.matching import joints_of
from pianobot_ros.axis.reading.columns.registers import signed
from pianobot_ros.axis.reading.columns.unit_scales import (
    FULL_TURNS,
    LINEAR,
    TURNING,
    effort_scale,
    extent,
    guessed_angle,
    sine_in_rad,
)
from pianobot_ros.axis.reading.headers.unit_words import parts_of
from pianobot_ros.axis.reading.headers.vocabulary import TURNED
from pianobot_ros.axis.reading.headers.words import tokens
from pianobot_ros.axis.reading.request import Request
from pianobot_ros.gap.problem.types import Array

__all__ = ["with_signs", "with_units"]

TURNS = (
    "positions taken as turns, as those of {} are, whose names these are; --units position=rad says"
    " so if not"
)


def with_signs(columns: Sequence[Column], notes: list[str]) -> list[Column]:
    """Columns with velocities and efforts decoded whose sign stands in a bit; each is noted."""
    out: list[Column] = []
    said: dict[str, list[str]] = {}
    for c in columns:
        found = signed(c.y) if c.role in {"velocity", "effort", "command effort"} else None
        if found is not None:
            said.setdefault(found[1], []).append(c.header)
        out.append(c if found is None else replace(c, y=found[0]))
    notes += [f"{', '.join(headers)}: whole numbers {how}" for how, headers in said.items()]
    return out


def with_units(
    columns: list[Column], t: Array, request: Request, notes: list[str], maker: str = ""
) -> list[Column]:
    """Positions and commands without a unit get that of the others, or a guess from all of them;
    joints of which the user said units are apart, and what is of no joint with a position (a
    policy's `ctrl_input`) has no say and is dropped. `maker`: of a drive that counts turns, if any.
    """
    joints = joints_of(columns)
    columns = [c for c in columns if c.joint in joints or not joints]
    shared = request.units_of("")
    apart = {c.joint for c in columns if request.units_of(c.joint) != shared}
    made = _with_units([c for c in columns if c.joint not in apart], t, shared, notes, maker)
    for joint in apart:
        own = [c for c in columns if c.joint == joint]
        made += _with_units(own, t, request.units_of(joint), notes, maker)
    order = {(c.table, c.header, c.joint): k for k, c in enumerate(columns)}
    return sorted(made, key=lambda c: order[c.table, c.header, c.joint])


def _with_units(
    columns: list[Column], t: Array, units: Mapping[str, str], notes: list[str], maker: str
) -> list[Column]:
    linear = any(parts_of(c.unit)[1] in LINEAR for c in columns if c.role in _PLACES)
    efforts = {effort_scale(c.unit)[1] for c in columns if c.role == "effort"}
    linear = linear or ("N" in efforts and "Nm" not in efforts and not _called_angles(columns))
    linear = linear or parts_of(units.get("position", ""))[1] in LINEAR
    columns = _as_said(columns, units)
    missing = [c for c in columns if c.role in _PLACES and not _known(c.unit)]
    _doubted(columns, notes)
    if not missing:
        return columns
    stated = {c.unit for c in columns if c.role == "position" and _known(c.unit)}
    wanted = {c.unit for c in columns if c.role == "command" and _known(c.unit)}
    speeds = {c.unit for c in columns if c.role == "velocity"}
    by_role: dict[str, str] = {}
    turns = bool(maker) and not stated and not linear
    if turns:
        notes.append(TURNS.format(maker))
        columns = [
            replace(c, unit="turn/s") if c.role == "velocity" and not c.unit else c for c in columns
        ]
    for role in ("position", "command", "error"):
        group = [c for c in missing if c.role == role]
        if not group:
            continue
        if len(stated) == 1:
            by_role[role] = next(iter(stated))
        elif role == "error":  # of what it is the error of
            of = by_role.get("command", by_role.get("position", "rad"))
            by_role[role] = next(iter(wanted)) if len(wanted) == 1 else of
        elif turns:
            by_role[role] = "turn"
        elif speeds == {"deg/s"} and not linear and role == "position":
            by_role[role] = _by_speed(columns, notes)
        else:
            said: list[str] = []
            turning = _turning(columns, t) if role == "position" and not linear else 1.0
            by_role[role] = guessed_angle([c.y for c in _taken(group)], linear, said, turning)
            if role == "position":
                notes += said
            elif by_role[role] != by_role.get("position", ""):
                by_role[role] = _same(columns, by_role)
                if by_role[role] != by_role.get("position", ""):
                    notes += [f"{role}: {n}" for n in said]
    guessed = not stated and not any(c.sure for c in columns)
    return [
        replace(c, unit=by_role[c.role], guessed=guessed) if c in missing else c for c in columns
    ]


def _doubted(columns: Sequence[Column], notes: list[str]) -> None:
    """Says where angles that are stated to be in rad are as large as only wheels' are, or degrees:
    a program may write degrees where its message is defined in rad.
    """
    group = _taken([c for c in columns if c.role == "position" and c.unit == "rad" and not c.sure])
    if group and guessed_angle([c.y for c in group], False, []) == "deg":
        size = extent([c.y for c in group])
        notes.append(f"positions are stated in rad, up to {size:.4g}; --units position=deg if not")


def _taken(group: Sequence[Column]) -> list[Column]:
    """The columns of one role that logs are made of: a motor's angle beside the joint's says
    nothing of the joints' unit.
    """
    own: dict[str, list[Column]] = {}
    for c in group:
        own.setdefault(c.joint, []).append(c)
    return [column for held in own.values() for column in chosen(held).values()]


_PLACES = ("position", "command", "error")


def _called_angles(columns: Sequence[Column]) -> bool:
    """Whether a position is called an angle: a force then pulls at a lever, as a cable or a cell
    between foot and ankle does.
    """
    return any(
        c.role == "position" and TURNED & {*tokens(c.table), *tokens(c.header)} for c in columns
    )


def _known(unit: str) -> bool:
    return parts_of(unit)[1] in {*TURNING, *LINEAR}


def _as_said(columns: list[Column], units: Mapping[str, str]) -> list[Column]:
    """Columns with the units that the user said; what goes beside a position has its unit, too."""
    for role in ("position", "command", "error"):
        if declared := units.get(role, ""):
            columns = [
                replace(c, unit=declared, sure=True) if c.role == role else c for c in columns
            ]
    if units.get("position") and not units.get("command"):
        unit = units["position"]
        columns = [
            replace(c, unit=unit) if c.role in {"command", "error"} and not c.unit else c
            for c in columns
        ]
    return columns


def _turning(columns: Sequence[Column], t: Array) -> float:
    """The clearest of what the joints' efforts say about rad or degrees; see `sine_in_rad`."""
    efforts = {c.joint: c for c in columns if c.role == "effort"}
    said = [
        sine_in_rad(t, c.y, efforts[c.joint].y)
        for c in columns
        if c.role == "position" and c.joint in efforts and extent([c.y]) > FULL_TURNS
    ]
    return min(said, default=1.0)


def _by_speed(columns: Sequence[Column], notes: list[str]) -> str:
    notes.append("positions taken as degrees, as the speeds are in degrees a second")
    return "deg"


def _same(columns: Sequence[Column], by_role: Mapping[str, str]) -> str:
    """The command's unit where it was guessed otherwise than the position's: the same if the two
    are of one size.
    """
    if "position" not in by_role:
        return by_role["command"]
    sizes = {}
    for role in ("position", "command"):
        spans = [
            float(np.nanstd(c.y)) for c in columns if c.role == role and np.isfinite(c.y).any()
        ]
        sizes[role] = float(np.median(spans)) if spans else 0.0
    comparable = min(sizes.values()) > 0.2 * max(sizes.values())
    return by_role["position"] if comparable else by_role["command"]
