"""A table with the meaning of its columns: by their headers, and by the name of its file."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pianobot_ros.axis.reading.columns.matching import SIGNALS
from pianobot_ros.axis.reading.formats.table import FEWEST, Table, stem_of
from pianobot_ros.axis.reading.headers.meaning import meaning, named, of_joint, with_context
from pianobot_ros.axis.reading.headers.phrases import names_a_joint, said_actual, silent
from pianobot_ros.axis.reading.headers.record import Meaning
from pianobot_ros.axis.reading.headers.stems import stem_joint, stem_rank, stem_unit
from pianobot_ros.axis.reading.headers.vocabulary import (
    BARE,
    DIRECTIONS,
    EFFORTS,
    FOREIGN,
    GROUPS,
    LETTER,
    OTHER,
    WORDS,
)
from pianobot_ros.axis.reading.headers.words import tokens
from pianobot_ros.gap.problem.types import Array

__all__ = ["Source", "of_a_joint", "of_channels", "still", "understood", "with_stem"]


AXES = 3
"""Letters with the same words behind them that are those of axes."""
_LETTER = re.compile(r"([A-Z])[ _.]+(\S.*)")
PHASE = EFFORTS["A"]
"""Words of a current."""
GAIN = frozenset({"kp"})
CHANNELS = frozenset({"ch", "chan", "channel", "channels", "kanal", "analog", "input", "ai"})
"""What scopes and converters call their inputs, by number."""
VARIABLES = (".mat", ".npz", ".npy", ".h5", ".hdf5")
"""Files that hold whatever a program had, rather than a table of one run."""


@dataclass(frozen=True)
class Source:
    """A table with the meaning of its columns."""

    table: Table
    meanings: tuple[Meaning, ...]

    def roles(self) -> set[str]:
        """Signals that the table holds."""
        return {m.role for m in self.meanings if m.role in SIGNALS}


def understood(table: Table, guess: bool = True) -> Source:
    """A table with what its headers say; where they name no signal at all, and `guess`, they are
    the joints of positions.
    """
    headers = list(table.columns)
    letters = _axis_letters(headers)
    found = _without_shared([_said(h, table, letters) for h in headers], table)
    found = [_with_unit(m, table.units.get(m.header, "")) for m in found]
    found = [replace(m, quantity="other") if _only_numbers(m, table) else m for m in found]
    if not any(m.role in SIGNALS for m in found) and guess:
        found = [_by_default(m, table) for m in found]
    found = _bare_joints(found, table) if guess else found
    found = _places(_behind_actual(_torque_making(found)), table)
    meanings = tuple(_named(m, table) for m in _of_topic(found, table))
    return Source(_under_control(table, meanings), meanings)


def _said(header: str, table: Table, letters: Mapping[str, str]) -> Meaning:
    """What a header says, as far as its table knows no better."""
    if header in table.foreign:
        return Meaning(header, FOREIGN)
    if header in table.owners:
        told = of_joint(header, table.owners[header], table.columns)
    else:
        told = (
            _of_axis(header, letters[header])
            if header in letters
            else meaning(header, table.columns)
        )
    known = table.clock and header != table.clock and told.quantity == "time"
    return Meaning(header, FOREIGN) if known else told


def _without_shared(found: Sequence[Meaning], table: Table) -> list[Meaning]:
    """Meanings in which joints that messages name are called so alone, unless what stands before
    the names tells joints apart (`left/position/elbow`, `right/position/elbow`).
    """
    own = {h: named(joint) for h, joint in table.owners.items()}
    signals = [m for m in found if m.header in own and m.role in SIGNALS]
    before = {m.joint.removesuffix(own[m.header]) for m in signals}
    if len(before) != 1:
        return list(found)
    return [replace(m, joint=own[m.header]) if m.header in own else m for m in found]


def _places(found: Sequence[Meaning], table: Table) -> list[Meaning]:
    """Meanings without the positions that only a word like "state" tells of, where others are
    called so, or where they never move and name no joint (a motor's state); or without letters
    (`feedback_x`) beside numbered joints (`feedback_j1`): x, y and z together are a tool's place.
    """
    bare = [m for m in found if m.role == "position" and m.rank >= BARE]
    there = {m.header: table.columns[m.header] for m in bare if m.header in table.columns}
    moving = {h for h, y in there.items() if not still(y)}
    kept = {m.header for m in bare if moving and _of_a_number(m)} | moving
    called = [m for m in found if m.role == "position" and m.rank < BARE]
    letters = {m.header for m in called if m.rank == LETTER}
    if called and len(letters) == len(called) and any(map(_of_a_number, bare)):
        left = letters
    else:
        left = {m.header for m in bare if called and m.rank == BARE}
        joints = {m.joint for m in called if m.header not in letters and _of_a_number(m)}
        left |= letters if len(joints) > 1 and _of_a_tool(letters) else set()
    left |= there.keys() - kept
    return [replace(m, quantity="other") if m.header in left else m for m in found]


def _of_a_tool(headers: Collection[str]) -> bool:
    """Whether x, y and z are all there."""
    return {w for h in headers for w in tokens(h)} >= DIRECTIONS


def _of_a_number(m: Meaning) -> bool:
    """Whether a header names a joint by its number, or by its limb."""
    return m.joint.isdigit() or (bool(m.joint) and names_a_joint(m.header))


def _torque_making(found: Sequence[Meaning]) -> list[Meaning]:
    """Meanings in which other currents come behind that of the q axis, where one is there: it alone
    has the sign of the torque.
    """
    efforts = {m.header: set(tokens(m.header)) for m in found if m.quantity == "effort"}
    if not any(w >= {"q", "axis"} or "iq" in w for w in efforts.values()):
        return list(found)
    plain = {h for h, w in efforts.items() if w & PHASE and not w & {"q", "iq"}}
    return [replace(m, rank=m.rank + 1) if m.header in plain else m for m in found]


def _of_topic(found: Sequence[Meaning], table: Table) -> list[Meaning]:
    """Meanings without the signals of a topic whose name says that it is of no joint (a battery's
    current), as a header does; what a message names a joint of is its own.
    """
    told = table.of_one_run and table.name != stem_of(table.path) and not table.joints
    if not told or not set(tokens(table.name)) & OTHER - GROUPS:
        return list(found)
    return [
        replace(m, quantity=FOREIGN, command=False)
        if m.role in SIGNALS and m.header not in table.owners
        else m
        for m in found
    ]


def _bare_joints(found: Sequence[Meaning], table: Table) -> list[Meaning]:
    """Meanings in which a column that is called by a joint's name alone (`J1` beside `J1 torque`)
    is its position, where none is called so; x, y and z are a tool's beside numbered joints.
    """
    said = [m for m in found if m.role in SIGNALS and m.rank != LETTER]
    if any(m.role == "position" for m in said):
        return list(found)
    joints = {m.joint for m in said if m.joint}
    return [
        _by_default(m, table) if m.joint in joints and names_a_joint(m.header) else m for m in found
    ]


def _behind_actual(found: Sequence[Meaning]) -> list[Meaning]:
    """Meanings in which what stands beside the same words with "actual" comes behind it: it is what
    was to be, as a PLC's `Position` and `Velocity` beside `ActualPosition` and `ActualVelocity`.
    """
    actual = {said for m in found if m.role in SIGNALS and (said := said_actual(m.header))}
    bare = {m.header for m in found if m.role in SIGNALS and tuple(tokens(m.header)) in actual}
    return [replace(m, rank=m.rank + 1) if m.header in bare else m for m in found]


def _only_numbers(m: Meaning, table: Table) -> bool:
    """Whether a column called a signal numbers the rows (a scope's `X`, also before each of its
    channels): nothing that was measured rises by 1 from each row to the next.
    """
    if m.role not in SIGNALS or table.columns.get(m.header, np.zeros(1)).size < FEWEST:
        return False
    return bool(np.all(np.diff(table.columns[m.header]) == 1.0))


def _axis_letters(headers: Sequence[str]) -> dict[str, str]:
    """Headers that begin with the letter of an axis (S, L, U, R, B, T of a Yaskawa), and what
    stands behind it: three axes or more have it, and it says a signal by itself. Directions are
    none.
    """
    behind: dict[str, list[str]] = {}
    for h in headers:
        if found := _LETTER.match(h):
            behind.setdefault(found[2], []).append(h)
    return {
        h: rest
        for rest, own in behind.items()
        if len({h[0] for h in own} - set("XYZ")) >= AXES and meaning(rest).role in SIGNALS
        for h in own
    }


def _of_axis(header: str, rest: str) -> Meaning:
    """What a header says that begins with the letter of an axis; `rest` is what stands behind."""
    told = meaning(rest)
    return replace(told, header=header, joint=f"{header[0].lower()} {told.joint}".strip())


def _under_control(table: Table, meanings: Collection[Meaning]) -> Table:
    """A table without the commanded positions that nobody regulates: those of rows where a gain
    `kp` that is named like them is 0, as in a robot that is steered by torques for a while.
    """
    gains = {_without(h, GAIN): h for h in table.columns if GAIN & set(tokens(h))}
    if not gains:
        return table
    columns = dict(table.columns)
    most, name = 0.0, ""
    for m in (m for m in meanings if m.role == "command" and m.header in columns):
        gain = gains.get(_without(m.header, WORDS["position"]))
        free = columns[gain] == 0.0 if gain else np.zeros(0, bool)
        if free.any():
            columns[m.header] = np.where(free, np.nan, columns[m.header])
            most, name = max((most, name), (float(free.mean()), m.header))
    note = f"commands are left out where their gain kp is 0 ({name}: {most:.0%} of the rows)"
    return replace(table, columns=columns, notes=(*table.notes, note) if name else table.notes)


def _without(header: str, words: Collection[str]) -> tuple[str, ...]:
    return tuple(w for w in tokens(header) if w not in words)


def _with_unit(m: Meaning, unit: str) -> Meaning:
    """A meaning with the unit that stands beside the header; a unit may tell the quantity."""
    if unit and m.quantity == "other":
        named = meaning(f"{m.header} [{unit}]")
        return replace(named, header=m.header)
    return replace(m, unit=unit or m.unit)


def _by_default(m: Meaning, table: Table) -> Meaning:
    """A column that only has a joint's name is a position, or what the file's name says. What is
    called anything in a file of variables is neither.
    """
    bare = m.quantity == "other" and m.header in table.columns and not table.headless
    if table.path.suffix.lower() in VARIABLES and not (table.joints or names_a_joint(m.header)):
        return m
    if (
        not bare
        or _of_channel(m.header)
        or set(tokens(m.header)) & OTHER
        or still(table.columns[m.header])
    ):
        return m
    key = m.joint or " ".join(tokens(m.header))
    alone = [h for h in table.columns if silent(h)] == [m.header]  # `value`: whose, the file says
    return replace(m, quantity="position", joint=m.joint if alone else key, rank=BARE)


def of_channels(table: Table) -> bool:
    """Whether all headers but a clock's are those of a scope's numbered channels, which say nothing
    of what was measured.
    """
    heads = [h for h, y in table.columns.items() if meaning(h).quantity != "time" and not still(y)]
    return bool(heads) and all(map(_of_channel, heads))


def _of_channel(header: str) -> bool:
    words = set(tokens(header))
    return bool(words & CHANNELS) and all(w in CHANNELS or w.isdigit() for w in words)


def still(y: Array) -> bool:
    """Whether a column only counts or never changes."""
    step = np.diff(y[np.isfinite(y)])
    return step.size == 0 or bool(np.all(step == step[0]))


def of_a_joint(source: Source, own: Collection[str]) -> Source:
    """A table whose columns name no joint is of the one that its file's name says, where the files
    say different ones.
    """
    joint = stem_joint(source.table.name)
    if not joint or len(own) < 2 or any(m.joint for m in source.meanings if m.role in SIGNALS):
        return source
    made = (replace(m, joint=joint) if m.role in SIGNALS else m for m in source.meanings)
    return replace(source, meanings=tuple(made))


def _named(m: Meaning, table: Table) -> Meaning:
    index = m.joint
    if index.isdigit() and int(index) < len(table.joints):
        return replace(m, joint=table.joints[int(index)])
    return m


def with_stem(source: Source, quantity: str, command: bool) -> Source:
    """A source with what its file's name adds: a quantity, whether commanded, an effort's unit."""
    if _of_variables(source):
        return source
    found = [_named(with_context(m, quantity, command), source.table) for m in source.meanings]
    if quantity != "effort":
        return replace(source, meanings=tuple(found))
    unit, rank = stem_unit(source.table.name), stem_rank(source.table.name)
    made = [replace(m, unit=m.unit or unit) if m.quantity == "effort" else m for m in found]
    told = (
        replace(m, rank=rank) if m.quantity == "effort" and old.quantity != "effort" else m
        for m, old in zip(made, source.meanings, strict=True)
    )
    return replace(source, meanings=tuple(told))


def _of_variables(source: Source) -> bool:
    """Whether a table is of several arrays of a file of variables, whose name is of none alone."""
    if source.table.path.suffix.lower() not in VARIABLES or source.table.headless:
        return False
    return len({m.header.split("[")[0] for m in source.meanings if m.role != "time"}) > 1
