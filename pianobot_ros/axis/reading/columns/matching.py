"""Which joint a column is of: names that differ between positions, commands and efforts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from pianobot_ros.axis.reading.columns.assemble import Column
from pianobot_ros.axis.reading.columns.relations import in_step
from pianobot_ros.axis.reading.formats.table import some_of

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
    the number of a joint: of more or fewer than the joints none is taken, unless they are followed.
    """
    joints = joints_of(columns) or list(dict.fromkeys(c.joint for c in columns))
    out = []
    for role in SIGNALS:
        own = [c for c in columns if c.role == role]
        if len(joints) == 1:
            fit = [c for c in own if c.joint == joints[0]] or own
            best = min((c.rank for c in fit), default=0)
            out += [replace(c, joint=joints[0]) for c in fit if c.rank == best][:1]
            continue
        for group in _arrays(own, joints):
            out += _renamed(group, joints, columns, notes)
    return out


def _arrays(own: Sequence[Column], joints: Sequence[str]) -> list[list[Column]]:
    """Columns of one role by the array that they are places of; all others are together, but what
    is of no joint at all is of none of several.
    """
    of: dict[tuple[str, str], list[Column]] = {}
    for c in own:
        array = c.joint.isdigit() and c.header.endswith("]")
        of.setdefault((c.table, c.header.rpartition("[")[0]) if array else ("", ""), []).append(c)
    several = [c for c in of.pop(("", ""), []) if c.joint or "" in joints]
    return [*of.values(), *([several] if several else [])]


def _renamed(
    own: list[Column], joints: Sequence[str], columns: Sequence[Column], notes: list[str]
) -> list[Column]:
    """Columns of one role with the names that the positions' `joints` have; see `matched`."""
    role = own[0].role
    names = list(dict.fromkeys(c.joint for c in own))
    places = _places(own, joints)
    strangers = [n for n in names if places or n not in joints]
    renamed: dict[str, str] = {}
    if strangers:
        renamed = _same_words(strangers, [j for j in joints if j not in names])
    alone = len(strangers) == len(names) and (places or len(names) == len(joints))
    if strangers and not renamed and alone:
        fit_by = in_step(names, own, columns) if role == "command" else []
        if len(names) != len(joints) and not fit_by:
            heads = some_of([c.header for c in own], 3)
            notes.append(f"{heads}: {role} of {len(names)} joints beside {len(joints)}, unused")
            return []
        renamed = dict(zip(names, fit_by or joints, strict=True))
        how = "what follows it" if fit_by else "their order"
        pairs = ", ".join(f"{a} is {b}" for a, b in renamed.items() if a != b)
        if pairs:
            notes.append(f"joints of {role} matched by {how}: {pairs}")
    return [replace(c, joint=renamed.get(c.joint, c.joint)) for c in own]


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
