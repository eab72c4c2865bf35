"""Which joint a column is of: names that differ between positions, commands and efforts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from pianobot_ros.axis.reading.columns.assemble import Column
from pianobot_ros.axis.reading.columns.relations import in_step

__all__ = ["SIGNALS", "joints_of", "matched"]

SIGNALS = (
    "command",
    "position",
    "motor",
    "velocity",
    "effort",
    "command effort",
    "error",
    "enable",
)


def joints_of(columns: Sequence[Column]) -> list[str]:
    """Joints that have positions, else those that have a command and its error."""
    places = [c.joint for c in columns if c.role == "position"]
    errors = [
        c.joint
        for c in columns
        if c.role == "error" and any(d.role == "command" and d.joint == c.joint for d in columns)
    ]
    return list(dict.fromkeys(places or errors))


def matched(columns: list[Column], notes: list[str]) -> list[Column]:
    """Columns whose joints are called otherwise than those of the positions, matched where clear:
    a single joint, or equally many that share their words, follow each other, or have one order;
    the last two are noted. Places in an array (`data[0]`) are no names, though one may look like
    the number of a joint.
    """
    joints = joints_of(columns) or list(dict.fromkeys(c.joint for c in columns))
    out = []
    for role in SIGNALS:
        own = [c for c in columns if c.role == role]
        names = list(dict.fromkeys(c.joint for c in own))
        places = _places(own, joints)
        strangers = [n for n in names if places or n not in joints]
        if len(joints) == 1:
            fit = [c for c in own if c.joint == joints[0]] or own
            best = min((c.rank for c in fit), default=0)
            out += [replace(c, joint=joints[0]) for c in fit if c.rank == best][:1]
            continue
        renamed: dict[str, str] = {}
        if strangers:
            renamed = _same_words(strangers, [j for j in joints if j not in names])
        alone = len(strangers) == len(names) and (places or len(names) == len(joints))
        if strangers and not renamed and alone:
            fit_by = in_step(names, own, columns) if role == "command" else []
            by_order = joints if len(names) == len(joints) else names
            renamed = dict(zip(names, fit_by or by_order, strict=True))
            how = "what follows it" if fit_by else "their order"
            pairs = ", ".join(f"{a} is {b}" for a, b in renamed.items() if a != b)
            if pairs:
                notes.append(f"joints of {role} matched by {how}: {pairs}")
        out += [replace(c, joint=renamed.get(c.joint, c.joint)) for c in own]
    return out


def _places(own: Sequence[Column], joints: Sequence[str]) -> bool:
    """Whether columns are called by their place in one array, from 0 on, and joints otherwise."""
    names = [c.joint for c in own]
    arrays = {c.header.rpartition("[")[0] for c in own}
    counted = names == [str(k) for k in range(len(names))] and len(names) > 1
    return counted and len(arrays) == 1 and "0" not in joints


def _same_words(names: Sequence[str], joints: Sequence[str]) -> dict[str, str]:
    """Names as joints that are left of the same words when what all have in common is taken away;
    empty unless all are.
    """
    if min(len(names), len(joints)) < 2:
        return {}
    of = {_apart(j, joints): j for j in joints}
    found = {n: of.get(_apart(n, names), "") for n in names}
    clear = all(found.values()) and len(set(found.values())) == len(names)
    return found if clear else {}


def _apart(name: str, names: Sequence[str]) -> tuple[str, ...]:
    shared = set.intersection(*(set(n.split()) for n in names))
    return tuple(w for w in name.split() if w not in shared)
