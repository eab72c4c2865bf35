"""From tables to the logs of a robot's joints: which files belong together, what a column is."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from pianobot_ros.axis.log import Log
from pianobot_ros.axis.reading.columns.assemble import Column, chosen, joint_log
from pianobot_ros.axis.reading.columns.long import by_joint, side_by_side
from pianobot_ros.axis.reading.columns.matching import SIGNALS, joints_of, matched
from pianobot_ros.axis.reading.columns.relations import (
    likenesses,
    not_followed,
    paired,
    related,
    without,
)
from pianobot_ros.axis.reading.columns.unit_scales import another_rate, unexplained
from pianobot_ros.axis.reading.columns.units import with_signs, with_units
from pianobot_ros.axis.reading.columns.variants import (
    called_twice,
    motors_apart,
    one_of_each,
    second_encoders,
)
from pianobot_ros.axis.reading.formats.table import Table, some_of, stem_of
from pianobot_ros.axis.reading.headers.meaning import turning
from pianobot_ros.axis.reading.headers.stems import stem_joint, stem_key, stem_says
from pianobot_ros.axis.reading.request import Request, as_named
from pianobot_ros.axis.reading.slopes import in_blocks
from pianobot_ros.axis.reading.source import Source, of_a_joint, understood
from pianobot_ros.axis.reading.together.files_of_a_run import episodes_of, groups_of, runs_of
from pianobot_ros.axis.reading.together.one_clock import clock_of, columns_on, main_of
from pianobot_ros.axis.reading.together.quantity_files import (
    beside_each_other,
    nameless,
    of_robots,
    together,
)
from pianobot_ros.axis.reading.together.topics import told_of_joints
from pianobot_ros.gap.problem.errors import GapError
from pianobot_ros.gap.problem.types import Array

MANY = 3
"""Joints whose efforts say together whether they are magnitudes."""
SIGNED = 0.05
"""Share of the rows in which an effort is below zero, that has a sign."""
OVERRIDE = " (--columns effort=HEADER takes it as signed)"


@dataclass(frozen=True)
class RobotRun:
    """One run of a robot: a log for each joint, what was taken as what, and what was not used."""

    name: str
    joints: Mapping[str, Log]
    taken: tuple[Column, ...]
    unused: tuple[str, ...]
    notes: tuple[str, ...]
    clock: str = ""
    likeness: Mapping[str, float] = field(default_factory=dict)
    """How much positions are like what a vague header calls their command; see `likenesses`."""


def read_recordings(paths: Iterable[str | Path], request: Request | None = None) -> list[RobotRun]:
    """Read logs of one robot; folders and files of one run are joined.

    Raises GapError in one line if a log cannot be used, naming what is missing.
    """
    request = request or Request()
    groups = together(groups_of([Path(p) for p in paths]))
    groups = [[side_by_side(t) for t in group] for group in groups]
    own = {stem_joint(t.name) for group in groups for t in group}
    read = [[of_a_joint(understood(t, request.silent), own) for t in group] for group in groups]
    robots = [own for group in read for own in of_robots(group)]
    runs = [told_of_joints(run) for own in robots for run in runs_of(own, request)]
    episodes = [e for run in runs for e in episodes_of(run)]
    made, problems = _each(episodes, request)
    apart = not_followed([r.likeness for r in made])
    if any(apart & r.likeness.keys() != not_followed([r.likeness]) for r in made):
        made, problems = _each(episodes, request, apart)  # what is a command is one in all runs
    if not made:
        raise GapError(problems[0] if problems else "no log was found in what was given")
    if any(s.table.robot for e in episodes for s in e):
        request.only_of([j for r in made for j in r.joints])
    if problems:
        made[0] = replace(made[0], notes=(*made[0].notes, *(f"left out: {p}" for p in problems)))
    return made


def _each(
    episodes: Sequence[Sequence[Source]],
    request: Request,
    no_commands: frozenset[str] | None = None,
) -> tuple[list[RobotRun], list[str]]:
    """Every run, and what was wrong with others; see `_recording`."""
    made: list[RobotRun] = []
    problems: list[str] = []
    for episode in episodes:
        try:
            made.append(_recording(episode, request, no_commands))
        except GapError as error:
            problems.append(str(error))
    return made, problems


def read_log(
    path: str | Path,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    joint: str = "",
) -> Log:
    """The log of one joint in one file; see `read_recordings`."""
    (recording, *_) = read_recordings([path], Request(columns or {}, units or {}))
    if joint and joint not in recording.joints:
        raise GapError(f"no joint {joint!r}; there are {', '.join(recording.joints)}")
    return recording.joints[joint] if joint else next(iter(recording.joints.values()))


def _recording(
    sources: Sequence[Source], request: Request, no_commands: frozenset[str] | None
) -> RobotRun:
    """One run; `no_commands` are headers of what the positions of all runs together do not follow,
    None where only this one tells.
    """
    notes: list[str] = [n for s in sources for n in s.table.notes]
    beside_each_other([s.table for s in sources])
    sources = [_tidy(s) for s in sources]
    apart = motors_apart([s.meanings for s in sources])
    sources = [replace(s, meanings=m) for s, m in zip(sources, apart, strict=True)]
    whole = True
    if request.columns:
        sources, whole = as_named(sources, request)
    main = main_of(sources)
    rows, t, clock = clock_of(main, request, notes)
    kept = tuple(m for m in main.meanings if m.header != clock or m.role == "time")
    bare, said = replace(main, meanings=kept), ""
    if request.silent and len(sources) == 1:
        bare, said = in_blocks(bare, clock, rows, t)
        notes += [said] if said else []
    others = [s for s in sources if s is not main]
    sources = [bare, *sorted(others, key=_rank_of_efforts)]
    got: list[Column] = []
    for source in sources:
        got += columns_on(source, bare, rows, t, request, notes, got)
    columns = with_signs([c for c in got if c.role in SIGNALS], notes)
    if not request.names("effort"):
        columns = _without_magnitudes(columns, notes)
    if whole and request.leaves_motion:
        columns = paired(columns, notes)
    if whole:
        columns = one_of_each(called_twice(second_encoders(columns, notes), notes), notes)
    columns = matched(columns, notes)
    alike: dict[str, float] = {}
    if whole and request.leaves_motion and not said:
        columns = matched(related(columns, _spare(got), t, notes), notes)
        alike = likenesses(columns)
        left = not_followed([alike]) if no_commands is None else no_commands
        columns = without(columns, left, notes)
    maker = turning([h for s in sources for h in s.table.columns])
    columns = _called(columns, bare.table.robot, request)
    columns = with_units(columns, t, request, notes, maker)
    name = _run_name(bare.table, len(sources) > 1)
    joints, taken, problems = _logs(columns, t, name, request, notes)
    if not joints:
        raise GapError(problems[0] if problems else _no_position(bare, sources))
    wrong = _another_rate(joints, taken, request, clock)
    if wrong:
        notes.append(wrong)
        joints = {k: replace(log, notes=(*log.notes, wrong)) for k, log in joints.items()}
    joints = _together(joints, request)
    notes += [f"joint left out: {p}" for p in problems]
    said_once, unused = tuple(dict.fromkeys(notes)), _unused(sources, taken, clock)
    return RobotRun(name, joints, tuple(taken), unused, said_once, clock, alike)


def _unused(sources: Sequence[Source], taken: Sequence[Column], clock: str) -> tuple[str, ...]:
    """Headers of what no log was made of, with their tables' names where there are several."""
    used = {(c.table, c.header) for c in taken}
    return tuple(
        f"{s.table.name}: {h}" if len(sources) > 1 else h
        for s in sources
        for h in s.table.columns
        if (s.table.name, h) not in used and h not in clock
    )


def _another_rate(
    joints: Mapping[str, Log], taken: Sequence[Column], request: Request, clock: str
) -> str:
    """What to say where another rate would bring all velocities to the slopes of positions; counts
    of a turn that were guessed say nothing of it.
    """
    places = {c.joint: c.unit for c in taken if c.role == "position"}
    units = {j: request.units_of(j) for j in joints}
    guessed = {j for j, u in places.items() if u.endswith("/turn") and "position" not in units[j]}
    logs = [
        (c, joints[c.joint], units[c.joint])
        for c in taken
        if c.role == "velocity" and c.joint not in guessed
    ]
    factors = [
        unexplained(own.get("velocity", c.unit), c.y, log.position, log.t, log.unit == "m")
        for c, log, own in logs
        if log.velocity is not None
    ]
    times = next(iter(joints.values())).t
    return another_rate(factors, 1.0 / float(np.median(np.diff(times))), clock != "(rate)")


def _spare(columns: Sequence[Column]) -> list[Column]:
    """Columns that no name says anything of."""
    return [c for c in columns if c.role not in SIGNALS]


def _called(columns: list[Column], robot: str, request: Request) -> list[Column]:
    """Columns whose joints are called by their robot, too, where there are several. Raises GapError
    if a unit is said of a joint that the only one has not.
    """
    if not robot:
        request.only_of(joints_of(columns))
        return columns
    return [replace(c, joint=f"{robot} {c.joint}".strip()) for c in columns]


def _rank_of_efforts(source: Source) -> int:
    """The best rank of a source's efforts: of two files of them the first one counts."""
    return min((m.rank for m in source.meanings if m.role == "effort"), default=0)


def _logs(
    columns: Sequence[Column], t: Array, name: str, request: Request, notes: Sequence[str]
) -> tuple[dict[str, Log], list[Column], list[str]]:
    """The log of each joint, the columns that they were made of, and what was wrong with others."""
    joints: dict[str, Log] = {}
    taken: list[Column] = []
    problems: list[str] = []
    shared = list(dict.fromkeys(notes))
    for joint in joints_of(columns):
        own = [c for c in columns if c.joint == joint]
        try:
            joints[joint] = joint_log(name, joint, t, own, request.units_of(joint), shared)
        except GapError as error:
            problems.append(str(error))
        else:
            taken += chosen(own).values()
    return joints, taken, problems


def _without_magnitudes(columns: list[Column], notes: list[str]) -> list[Column]:
    """Columns without efforts that only tell how large they are, where others of the same joints
    have a sign.
    """
    efforts = [c for c in columns if c.role == "effort"]
    signed = {c.joint for c in efforts if np.mean(c.y < 0.0) > SIGNED}
    sizes = [c for c in efforts if c.joint in signed and np.nanmin(c.y, initial=0.0) >= 0.0]
    if not sizes:
        return columns
    heads = some_of([c.header for c in sizes], 3)
    notes.append(f"{heads}: never negative, so left out beside efforts with a sign{OVERRIDE}")
    return [c for c in columns if c not in sizes]


def _together(joints: Mapping[str, Log], request: Request) -> dict[str, Log]:
    """Logs that know the positions of each other; efforts that are never negative in any of three
    joints or more are magnitudes, unless the user named the column.
    """
    named = request.names("effort")
    least = [float(np.nanmin(x.effort)) for x in joints.values() if x.effort is not None]
    sizes = len(least) >= MANY and min(least) >= 0.0 and not named
    out = {}
    for name, log in joints.items():
        others = {n: x.joint_position for n, x in joints.items() if n != name}
        made = replace(log, others=others, joints=tuple(joints), signed=named)
        if sizes and log.effort is not None:
            said = f"no joint's effort ever turns negative: a magnitude, left out{OVERRIDE}"
            made = replace(made, effort=None, notes=(*log.notes, said))
        out[name] = made
    return out


def _run_name(table: Table, joined: bool) -> str:
    """What a run is called: as its table; of several topics as their file, of several files, whose
    names only tell quantities, as their folder.
    """
    if joined and table.of_one_run:
        return stem_of(table.path)
    return table.path.parent.name if joined and not stem_key(table.name) else table.name


def _no_position(main: Source, sources: Sequence[Source]) -> str:
    files = ", ".join(dict.fromkeys(s.table.path.name for s in sources))
    headers = some_of(main.table.columns)
    if main.table.clock:
        topics = some_of(dict.fromkeys(s.table.name for s in sources))
        return (
            f"{files}: none of its topics tells a joint's position; say --columns position=HEADER."
            f" Topics: {topics}; columns of the first: {headers}"
        )
    if main.table.texts:
        words = some_of([f"{h} ({v[-1]})" for h, v in main.table.texts.items() if v], 5)
        headers += f"; of words, which are not read: {words}"
    told = stem_says(main.table.name)[0]
    if told not in {"", "position"} and nameless(main.table):
        return (
            f"{files}: the name says {told}, and there is no file of positions beside it that"
            " differs in nothing but that and has as many rows; give the files of one run together,"
            f" or say --columns position=HEADER. Columns: {headers}"
        )
    found = {m.role: m.header for s in sources for m in s.meanings if m.role in SIGNALS}
    named = ", ".join(f"{role} = {header}" for role, header in found.items())
    how = " (numbers from 0, a range for several joints: position=1-6)"
    summed = "; a speed alone must be summed up over time, into a column of positions"
    return (
        f"{files}: no column of positions{f' (there is {named})' if named else ''}; say --columns"
        f" position=HEADER{how if main.table.headless else ''}, or error=HEADER beside a"
        f" command{summed if 'velocity' in found else ''}. Columns: {headers}"
    )


def _tidy(source: Source) -> Source:
    """A table with a row for each joint and time as one with columns for each joint."""
    made = by_joint(source.table, source.meanings, lambda m: m.role in SIGNALS)
    return source if made is None else Source(*made)
