"""Several columns of one thing, of which one is taken: an angle by two encoders, raw and filtered,
measured and modelled.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from pianobot_ros.axis.reading.columns.assemble import Column, chosen
from pianobot_ros.axis.reading.columns.relations import CLOSE, SIDES, left_over
from pianobot_ros.axis.reading.formats.table import some_of
from pianobot_ros.axis.reading.headers.record import Meaning
from pianobot_ros.axis.reading.headers.vocabulary import LIMBS, MOTOR
from pianobot_ros.axis.reading.headers.words import tokens

__all__ = ["called_twice", "motors_apart", "one_of_each", "second_encoders"]

FELT = {"effort", "command effort", "velocity"}
SAME, APART = 1e-3, 0.1
"""Share of a position's variance that the same one leaves, read at another time, at most; and share
of what the next best leaves."""
SECOND = {"2", "abs", "absolute", "secondary"}
"""What drives call an encoder that is not the one by which they commutate."""
DRIVES = ("command", "effort", "command effort")
Words = tuple[str, ...]


def motors_apart(meanings: Sequence[Sequence[Meaning]]) -> list[tuple[Meaning, ...]]:
    """Meanings by table in which the position of a motor, where the joint's own stands beside it,
    is no second position of the joint but its motor's: by a word, as theta beside q, or as q_m
    beside q_l (so Spong 1987, Albu-Schäffer et al. 2007, libfranka).
    """
    said = [m for own in meanings for m in own if m.role == "position"]
    words = {m.header: tokens(m.header) for m in said}
    links = {_of_link(words[m.header]): m for m in said if "m" in words[m.header]}
    pairs = [(m, links[key]) for m in said if (key := tuple(words[m.header])) in links]
    joint_of = {link.header: motor.joint for link, motor in pairs}
    letters = {motor.header for _, motor in pairs}
    own_angle = {m.joint for m in said if "q" in words[m.header]}

    def of_motor(m: Meaning) -> bool:
        told = set(words.get(m.header, ()))
        by_letter = m.header in letters or ("theta" in told and m.joint in own_angle)
        return m.role == "position" and (bool(MOTOR & told) or by_letter)

    there = {joint_of.get(m.header, m.joint) for m in said if not of_motor(m)}
    out = []
    for own in meanings:
        named = [replace(m, joint=joint_of.get(m.header, m.joint)) for m in own]
        apart = (of_motor(m) and m.joint in there for m in named)
        made = zip(named, apart, strict=True)
        out.append(tuple(replace(m, quantity="motor") if a else m for m, a in made))
    return out


def _of_link(words: Sequence[str]) -> Words:
    """The words of a motor's position as those of its link's would be."""
    other = {"m": "l", "motor": "link"}
    return tuple(other.get(w, w) for w in words)


def second_encoders(columns: list[Column], notes: list[str]) -> list[Column]:
    """Columns in which a second position of a joint (`ActPos2` beside `ActPos`) is the joint's own
    and the first its motor's, as drives number or call them: where nothing drives a joint of that
    name, and the two move alike.
    """
    driven = {c.joint for c in columns if c.role in DRIVES}
    places = {c.joint: c for c in columns if c.role == "position"}
    of: dict[str, str] = {}
    for joint, c in places.items():
        first, _, which = joint.rpartition(" ")
        if which not in SECOND or joint in driven or first not in driven or first not in places:
            continue
        if left_over(places[first].y, c.y) < CLOSE:
            of[joint] = first
            notes.append(f"{c.header} is a second encoder of {places[first].header}'s joint")
    return [
        replace(c, joint=of[c.joint])
        if c.joint in of
        else replace(c, role="motor")
        if c.role == "position" and c.joint in of.values()
        else c
        for c in columns
    ]


def called_twice(columns: list[Column], notes: list[str]) -> list[Column]:
    """Columns of joints that two topics of one file call otherwise, under one name: those with a
    command and no effort or velocity are those with these and no command whose positions they have,
    each another one.
    """
    roles: dict[str, set[str]] = {}
    places: dict[str, Column] = {}
    for c in columns:
        roles.setdefault(c.joint, set()).add(c.role)
        if c.role == "position":
            places.setdefault(c.joint, c)
    driven = [j for j in places if "command" in roles[j] and not roles[j] & FELT]
    felt = [j for j in places if "command" not in roles[j] and roles[j] & FELT]
    if not driven or len(driven) > len(felt):
        return columns
    of: dict[str, str] = {}
    for j in driven:
        left = sorted((left_over(places[k].y, places[j].y), k) for k in felt)
        alone = len(left) == 1 or left[0][0] < APART * left[1][0]
        if left[0][0] > SAME or not alone or left[0][1] in of.values():
            return columns
        of[j] = left[0][1]
    pairs = ", ".join(f"{a} is {b}" for a, b in of.items())
    notes.append(f"joints of one position under two names: {pairs}")
    return [replace(c, joint=of.get(c.joint, c.joint)) for c in columns]


def one_of_each(columns: list[Column], notes: list[str]) -> list[Column]:
    """Columns of which only a qualifier sets some apart (`motor`, `filtered`), one of each joint
    and role: of the positions those that move in most joints, of the others what shares most words
    with them.

    A word is a joint's own if it stands in a name that positions and drives (commands, efforts)
    share; where they share none, if it tells both positions and drives apart.
    """
    columns = _without_group(columns)
    of = _joints(columns)
    if not of:
        return _told(columns, _second(columns), notes)
    places = [c for c in columns if c.role == "position"]
    said = _qualifier(places, of)
    out, left = [], []
    for role in dict.fromkeys(c.role for c in columns):
        own: dict[Words, list[Column]] = {}
        for c in columns:
            if c.role == role:
                own.setdefault(of.get(c.joint, (c.joint,)), []).append(c)
        for joint, found in own.items():
            best = min(found, key=lambda c: (c.rank >= 0, *_foreign(c, of, said), c.rank))
            out.append(replace(best, joint=" ".join(joint)))
            left += [c.header for c in found if c is not best]
    order = {c.header: k for k, c in enumerate(columns)}
    out.sort(key=lambda c: order[c.header])
    return _told(out, [*left, *_second(out)], notes)


def _told(columns: list[Column], left: Sequence[str], notes: list[str]) -> list[Column]:
    """The columns, after a note on those that were left out: the first one of each array first."""
    if left:
        first = {re.sub(r"\d+", "", header): header for header in reversed(left)}
        shown = sorted(left, key=lambda header: header not in first.values())
        notes.append(
            f"{some_of(shown, 3)} left out beside others of the same joints (--columns takes them)"
        )
    return columns


def _second(columns: Sequence[Column]) -> list[str]:
    """Headers of columns of whose joint and role another one is taken; what is measured and what is
    calculated are one role.
    """
    own: dict[str, list[Column]] = {}
    for c in columns:
        own.setdefault(c.joint, []).append(c)
    taken = {j: chosen(held) for j, held in own.items() if any(c.role == "position" for c in held)}
    return [
        c.header
        for c in columns
        if c.joint in taken and c.role != "enable"
        if taken[c.joint].get(c.role.removeprefix("command "), c) is not c
    ]


def _without_group(columns: list[Column]) -> list[Column]:
    """Columns without the words that all positions' joints begin with, if those are an array's or
    a robot's (`robot0`) rather than a side or a limb.
    """
    places = [c for c in columns if c.role == "position"]
    names = [c.joint.split() for c in {c.joint: c for c in places}.values()]
    arrays = all(c.header.endswith("]") for c in places)
    shared, most = 0, min(map(len, names), default=0) - 1  # a word of its own is left to each
    while len(names) > 1 and shared < most and len({n[shared] for n in names}) == 1:
        word = names[0][shared]
        if word in LIMBS | SIDES or not (arrays or word.isdigit()):
            break
        shared += 1
    group = names[0][:shared] if shared else []
    of = {c.joint: c.joint.split() for c in columns}
    short = {
        j: " ".join(words[shared:]) if words[:shared] == group and words[shared:] else j
        for j, words in of.items()
    }
    return [replace(c, joint=short[c.joint]) for c in columns] if group else columns


def _joints(columns: Sequence[Column]) -> dict[str, Words]:
    """The joint's own words of every name that has some and that some position has; empty if
    nothing is there twice and every drive has its position already.
    """
    places = dict.fromkeys(c.joint for c in columns if c.role == "position")
    drives = dict.fromkeys(c.joint for c in columns if c.role in DRIVES)
    shared = places.keys() & drives.keys()
    own = {w for name in shared for w in name.split()}
    if not shared:
        own = _telling(places) & _telling(drives)
    short = {c.joint: tuple(w for w in c.joint.split() if w in own | LIMBS) for c in columns}
    joints = {short[name] for name in places} - {()}
    driven = joints & {short[name] for name in drives}
    twice = len(joints) < sum(1 for name in places if short[name])
    if not driven or (shared and not twice):
        return {}
    return {name: words for name, words in short.items() if words in joints}


def _telling(names: Collection[str]) -> set[str]:
    """Words that some of the names have and others have not."""
    held = [set(name.split()) for name in names]
    return {w for words in held for w in words if not all(w in other for other in held)}


def _qualifier(places: Sequence[Column], of: Mapping[str, Words]) -> frozenset[str]:
    """The words beside the joint's of those positions that move in most joints."""
    moves: dict[frozenset[str], int] = {}
    for c in places:
        known, words = c.y[np.isfinite(c.y)], _others(c, of)
        moves[words] = moves.get(words, 0) + bool(known.size and np.ptp(known) > 0)
    return min(moves, key=lambda words: (-moves[words], len(words)))


def _foreign(column: Column, of: Mapping[str, Words], said: frozenset[str]) -> tuple[int, int]:
    """How many words of the positions' qualifier a column's name lacks, and how many others it
    has.
    """
    words = _others(column, of)
    return len(said - words), len(words - said)


def _others(column: Column, of: Mapping[str, Words]) -> frozenset[str]:
    return frozenset(column.joint.split()) - set(of.get(column.joint, ()))
