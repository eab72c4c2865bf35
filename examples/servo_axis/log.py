"""Logs as laboratories have them: CSV in, columns found by name, units declared or guessed, one clean time base out."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pianobot_ros.gap.errors import GapError
from pianobot_ros.gap.types import Array

ROLES = ("time", "command", "position", "velocity", "effort")
_WORDS = {
    "time": ("time", "timestamp", "stamp", "t", "sec", "secs", "seconds", "ms", "clock"),
    "command": ("command", "cmd", "target", "goal", "setpoint", "desired", "des", "ref", "reference"),
    "velocity": ("velocity", "vel", "speed", "qd", "dq", "omega", "qdot", "rpm"),
    "effort": ("effort", "torque", "current", "tau", "cur", "load", "pwm", "nm", "amp", "trq", "i"),
    "position": ("position", "pos", "angle", "q", "theta", "enc", "encoder", "actual", "measured", "joint"),
}


@dataclass(frozen=True)
class Log:
    """Columns of one log, each (n,): t in s from 0, angles in rad, effort in `effort_unit`; None where not recorded."""

    name: str
    t: Array
    command: Array | None
    position: Array
    velocity: Array | None
    effort: Array | None
    effort_unit: str = ""
    notes: tuple[str, ...] = field(default=())


def read_csv(path: str | Path, columns: Mapping[str, str] | None = None, units: Mapping[str, str] | None = None) -> Log:
    """Read one CSV (or semicolon, tab or space separated) log.

    What is safe to mend is mended and said in `notes` (see `repair.py`). `columns` maps a role (time, command, position,
    velocity, effort) to a column's header or number (from 0), "-" for none; missing roles are guessed from the headers.
    `units` maps a role to its unit: s ms us ns; rad deg turn 4096/turn; rad/s deg/s rpm; Nm mNm A mA %. Raises GapError if
    time or position cannot be found.
    """
    from examples.servo_axis.repair import astray, despiked, in_order, unwrapped  # they work on the Log defined here

    path = Path(path)
    header, table = _table(path)
    roles = _assign(header, dict(columns or {}), path)
    units = dict(units or {})
    notes = ["columns taken: " + ", ".join(f"{role} = {header[i]}" for role, i in roles.items())]
    raw = {role: table[:, i] for role, i in roles.items()}
    t = raw["time"] * _time_scale(header[roles["time"]], raw["time"], units.get("time"), notes)
    good = np.isfinite(t)
    good[good] = ~astray(t[good])
    t = in_order(t[good], notes)
    order = np.argsort(t, kind="stable")
    t, first = np.unique(t[order], return_index=True)
    if t.size < 20:
        raise GapError(f"{path.name}: only {t.size} rows with different time stamps; at least 20 are needed")

    def column(role: str) -> Array | None:
        if role not in raw:
            return None
        values = raw[role][good][order][first]
        values = np.where(np.isfinite(values), values, np.nan)
        return values if np.isfinite(values).sum() > 0.3 * values.size else None

    position = column("position")
    if position is None:
        raise GapError(
            f"{path.name}: the position column is (almost) empty; name another with --columns position=HEADER"
        )
    angles = [a for a in (position, column("command")) if a is not None]
    scale = _angle_scale(header[roles["position"]], angles, units.get("position"), notes)
    command = column("command")
    if command is not None:
        declared = units.get("command")
        command = command * (_angle_scale(header[roles["command"]], angles, declared, []) if declared or
                             _unit_in(header[roles["command"]]) else scale)  # fmt: skip
    position = unwrapped(despiked(position * scale, "position", notes), "position", notes)
    velocity, speed_unit = column("velocity"), units.get("velocity", "")
    if velocity is not None:
        velocity = velocity * _speed_scale(header[roles["velocity"]], velocity, position, t, speed_unit, notes)
    effort, effort_unit = column("effort"), ""
    if effort is not None:
        effort_unit = units.get("effort") or _effort_unit(header[roles["effort"]])
    return Log(path.stem, t - t[0], command, position, velocity, effort, effort_unit, tuple(notes))


def _table(path: Path) -> tuple[list[str], Array]:
    if not path.is_file():
        raise GapError(f"{path}: no such log")
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    lines: list[str] = []
    comment = ""
    for line in text.splitlines():
        bare = line.lstrip()
        if bare.startswith(("#", "%", "//")):
            comment = comment if lines else bare.lstrip("#%/ ")
        elif bare:
            lines.append(line)
    if len(lines) < 3:
        raise GapError(f"{path.name}: no rows")
    delimiter = max(";\t,", key=lambda d: min(lines[0].count(d), lines[2].count(d)))  # a decimal comma is no separator
    if lines[2].count(delimiter) == 0:
        delimiter = " "
    rows = [[c.strip() for c in row if delimiter != " " or c.strip()] for row in csv.reader(lines, delimiter=delimiter)]
    header, body = rows[0], rows[1:]
    if all(_number(c) is not None for c in header):  # no header, or one behind a comment sign (numpy, rostopic)
        behind = [
            c.strip() for c in next(csv.reader([comment], delimiter=delimiter), []) if delimiter != " " or c.strip()
        ]
        header, body = (behind if len(behind) == len(header) else [f"column{i}" for i in range(len(header))]), rows
    width = len(header)
    comma = delimiter != ","
    table = np.array([[_cell(r[i], comma) if i < len(r) else math.nan for i in range(width)] for r in body], float)
    return header, table


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _cell(text: str, comma: bool) -> float:
    value = _number(text.replace(",", ".") if comma else text)
    return math.nan if value is None else value


def _tokens(header: str) -> list[str]:
    split = re.sub(r"([a-z])([A-Z])", r"\1 \2", header)
    return [w for w in re.split(r"[^a-z0-9]+|(?<=[a-z])(?=[0-9])", split.lower()) if w]


def _assign(header: list[str], columns: dict[str, str], path: Path) -> dict[str, int]:  # noqa: PLR0912
    roles: dict[str, int] = {}
    for role, name in columns.items():
        if role not in ROLES:
            raise GapError(f"unknown column role {role!r}; valid: {', '.join(ROLES)}")
        if name == "-":
            continue
        if name in header:
            roles[role] = header.index(name)
        elif name.isdigit() and int(name) < len(header):
            roles[role] = int(name)
        else:
            raise GapError(f"{path.name}: no column {name!r}; it has {', '.join(header)}")
    taken = set(roles.values())
    for role in ("time", "command", "velocity", "effort", "position"):
        if role in columns:
            continue
        for i, head in enumerate(header):
            words = _tokens(head)
            if i in taken or not (any(w in _WORDS[role] for w in words) or (role == "command" and _desired(head))):
                continue
            if role == "command" and any(w in (*_WORDS["velocity"], *_WORDS["effort"]) and len(w) > 1 for w in words):
                continue
            if role in ("velocity", "effort") and (any(w in _WORDS["command"] for w in words) or _desired(head)):
                continue
            roles[role] = i
            taken.add(i)
            break
    for role in ("time", "position"):
        if role not in roles:
            raise GapError(f"{path.name}: cannot tell which column is {role}; say --columns {role}=HEADER "
                           f"(headers: {', '.join(header)})")  # fmt: skip
    return roles


def _desired(header: str) -> bool:
    """Textbook names of a commanded position (`q_d`, `theta_r`, `qref`); `qd` is a velocity."""
    name = header.strip().lower()
    return re.fullmatch(r"(q|theta|phi|pos|position|angle)(_(d|r|star)|_?(ref|des|cmd))[_0-9]*", name) is not None


def _unit_in(header: str) -> str:
    words = _tokens(header)
    for unit, names in (("deg", ("deg", "degree", "degrees")), ("rad", ("rad", "radian", "radians")),
                        ("turn", ("turn", "turns", "rev"))):  # fmt: skip
        if any(w in names for w in words):
            return unit
    return ""


def _time_scale(header: str, t: Array, declared: str | None, notes: list[str]) -> float:
    scales = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
    if declared:
        if declared not in scales:
            raise GapError(f"unknown unit of time {declared!r}; valid: {', '.join(scales)}")
        return scales[declared]
    for unit in ("ms", "us", "ns"):
        if unit in _tokens(header):
            return scales[unit]
    step = np.diff(t[np.isfinite(t)])
    typical = float(np.median(step[step > 0])) if np.any(step > 0) else 1.0
    for unit, scale in scales.items():
        if 2e-4 <= typical * scale <= 0.15:
            if unit != "s":
                notes.append(f"time stamps taken as {unit} (typical step {typical:g})")
            return scale
    return 1.0


def _angle_scale(header: str, angles: list[Array], declared: str | None, notes: list[str]) -> float:
    scales = {"rad": 1.0, "deg": math.pi / 180, "turn": 2 * math.pi}
    unit = declared or _unit_in(header)
    if unit:
        counts = re.fullmatch(r"([0-9.]+)/turn", unit)
        if counts and float(counts[1]) > 0:
            return 2 * math.pi / float(counts[1])
        if unit not in scales:
            raise GapError(
                f"unknown unit of position {unit!r}; valid: {', '.join(scales)}, or 4096/turn for encoder counts"
            )
        return scales[unit]
    spread = max(float(np.ptp(np.quantile(a[np.isfinite(a)], [0.01, 0.99]))) for a in angles)  # a spike says nothing
    if spread > 15.0:
        notes.append(f"positions taken as degrees (they span {spread:.0f}); say --units position=rad if not")
        return scales["deg"]
    return 1.0


def _speed_scale(header: str, velocity: Array, position: Array, t: Array, declared: str, notes: list[str]) -> float:
    scales = {"rad/s": 1.0, "deg/s": math.pi / 180, "rpm": 2 * math.pi / 60, "turn/s": 2 * math.pi}
    if declared:
        if declared not in scales:
            raise GapError(f"unknown unit of velocity {declared!r}; valid: {', '.join(scales)}")
        return scales[declared]
    slope = np.gradient(position, t)
    ok = np.isfinite(slope) & np.isfinite(velocity)
    power = float(np.sum(velocity[ok] ** 2))
    if power <= 0:
        return 1.0
    fitted = float(np.sum(slope[ok] * velocity[ok]) / power)
    likeness = fitted * math.sqrt(power / max(float(np.sum(slope[ok] ** 2)), 1e-300))
    unit, scale = min(scales.items(), key=lambda kv: abs(math.log(max(abs(fitted), 1e-9) / kv[1])))
    if abs(likeness) < 0.8:  # too noisy or too different to judge: as declared by its header, else rad/s
        return next((s for u, s in (("deg", scales["deg/s"]), ("rpm", scales["rpm"])) if u in _tokens(header)), 1.0)
    if abs(math.log(abs(fitted) / scale)) > 0.15:
        notes.append(
            f"velocity multiplied by {fitted:.4g}, so that it matches the slope of position (its unit is unknown)"
        )
        return fitted
    if fitted < 0:
        notes.append("velocity counts against position; taken with the other sign")
    if unit != "rad/s":
        notes.append(f"velocity taken as {unit} because it then matches the slope of position")
    return math.copysign(scale, fitted)


def _effort_unit(header: str) -> str:
    words = _tokens(header)
    for unit, names in (("mA", ("ma", "milliamp")), ("mNm", ("mnm",)), ("Nm", ("nm", "torque", "tau", "trq")),
                        ("A", ("a", "amp", "amps", "current", "cur", "i")), ("%", ("pwm", "percent", "load"))):  # fmt: skip
        if any(w in names for w in words):
            return unit
    return "effort"
