"""What was read as what, before anything is computed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pianobot_ros.axis.log import Log
from pianobot_ros.axis.reading.formats.table import some_of
from pianobot_ros.axis.reading.recordings import RobotRun


def listing(recording: RobotRun) -> dict[str, Any]:
    """Columns by role with unit, rate and range, of each joint; plain JSON types."""
    return {
        "recording": recording.name,
        "clock": recording.clock,
        "joints": {
            (name or "(one joint)"): _joint(recording, name, log)
            for name, log in recording.joints.items()
        },
        "unused": list(recording.unused),
        "notes": list(dict.fromkeys([*recording.notes, *_said(recording)])),
    }


def text(recording: RobotRun) -> list[str]:
    """The listing in lines."""
    listed = listing(recording)
    lines = [f"{listed['recording']}: time = {listed['clock']}"]
    for name, joint in listed["joints"].items():
        pace = f"{joint['rate']:.4g} Hz, {joint['duration']:.1f} s, {joint['rows']} rows"
        lines.append(f"  {name}: {pace}")
        for role, c in joint["columns"].items():
            reach = f"{c['low']:.4g} to {c['high']:.4g}"
            lines.append(
                f"    {role:<9} = {c['header']:<28} {c['unit']:<6} {reach}"
                + (f", {100 * c['missing']:.0f} % missing" if c["missing"] > 0.005 else "")
            )
        missing = [r for r in ("command", "velocity", "effort") if r not in joint["columns"]]
        if missing:
            alone = {"command", "effort"} <= set(missing)
            needed = "; a diagnosis needs a command or an effort" if alone else ""
            lines.append(f"    no {', '.join(missing)}{needed}")
    if listed["unused"]:
        lines.append(f"  not used: {some_of(listed['unused'], 40)}")
    return [*lines, *(f"  note: {n}" for n in listed["notes"])]


def _said(recording: RobotRun) -> list[str]:
    out = []
    for name, log in recording.joints.items():
        shared = set(recording.notes)
        own = [n for n in log.notes if n not in shared and not n.startswith("columns taken")]
        out += [f"{name}: {n}" if name else n for n in own]
    return out


def _joint(recording: RobotRun, name: str, log: Log) -> dict[str, Any]:
    step = np.diff(log.t)
    columns: dict[str, Any] = {}
    units = {"velocity": f"{log.unit}/s", "effort": log.effort_unit}
    held = {"motor": log.position, "position": log.link} if log.link is not None else {}
    for role in ("command", "position", "motor", "velocity", "effort"):
        y = held[role] if role in held else getattr(log, role, None)
        if y is None:
            continue
        known = y[np.isfinite(y)]
        columns[role] = {
            "header": _header(recording, name, role),
            "unit": units.get(role, log.unit),
            "low": float(known.min()) if known.size else math.nan,
            "high": float(known.max()) if known.size else math.nan,
            "missing": float(1.0 - known.size / y.size),
        }
    return {
        "rows": int(log.t.size),
        "duration": float(log.t[-1]),
        "rate": float(1.0 / np.median(step)),
        "columns": columns,
    }


def _header(recording: RobotRun, joint: str, role: str) -> str:
    roles = {"effort": ("effort", "command effort"), "position": ("position", "error")}
    for want in roles.get(role, (role,)):
        own = [c for c in recording.taken if c.joint == joint and c.role == want]
        if own:
            best = min(own, key=lambda c: c.rank)
            many = len({c.table for c in recording.taken}) > 1
            header = f"{best.table}: {best.header}" if many else best.header
            return header if want != "error" else f"command - {header}"
    return "-"
