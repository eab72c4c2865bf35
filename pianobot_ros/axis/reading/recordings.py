"""From tables to the logs of a robot's joints: which files belong together, what a column is."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.axis.log import Log
from pianobot_ros.axis.reading.columns.assemble import Column, chosen, joint_log
from pianobot_ros.axis.reading.columns.clock import onto, ordered, time_of
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
from pianobot_ros.axis.reading.formats.files import REFUSED, SUFFIXES, kind_of, tables_of
from pianobot_ros.axis.reading.formats.lines.bottles import dumped
from pianobot_ros.axis.reading.formats.lines.echoed import holds_documents
from pianobot_ros.axis.reading.formats.table import FEWEST, RUNS, Table, some_of, stem_of
from pianobot_ros.axis.reading.formats.time_file import with_time_file
from pianobot_ros.axis.reading.headers.meaning import states, turning
from pianobot_ros.axis.reading.headers.record import Meaning
from pianobot_ros.axis.reading.headers.stems import stem_joint, stem_key, stem_says
from pianobot_ros.axis.reading.headers.vocabulary import OTHER
from pianobot_ros.axis.reading.headers.words import tokens
from pianobot_ros.axis.reading.request import Request, as_named
from pianobot_ros.axis.reading.slopes import in_blocks
from pianobot_ros.axis.reading.source import Source, of_a_joint, still, understood, with_stem
from pianobot_ros.axis.reading.together.quantity_files import (
    beside_each_other,
    nameless,
    of_robots,
    together,
)
from pianobot_ros.axis.reading.together.topics import told_of_joints
from pianobot_ros.gap.problem.errors import GapError
from pianobot_ros.gap.problem.types import Array

Rows: TypeAlias = NDArray[np.intp]
FULL = 0.9
"""Share of the rows from which on a column counts as filled."""
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
    groups = together(_groups([Path(p) for p in paths]))
    groups = [[side_by_side(t) for t in group] for group in groups]
    own = {stem_joint(t.name) for group in groups for t in group}
    read = [[of_a_joint(understood(t, request.silent), own) for t in group] for group in groups]
    robots = [own for group in read for own in of_robots(group)]
    runs = [told_of_joints(run) for own in robots for run in _runs(own, request)]
    episodes = [e for run in runs for e in _episodes(run)]
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


# -- which files belong together ---------------------------------------------------------------
def _groups(paths: Sequence[Path]) -> list[list[Table]]:
    """Tables that may be one run: those of a folder or of names that differ by a role only."""
    files: dict[tuple[object, ...], list[Path]] = {}
    for path in paths:
        if not path.exists():
            raise GapError(f"{path}: no such log")
        folder = path.is_dir() and not (path / "metadata.yaml").is_file()
        for f in _inside(path) if folder else [path]:
            files.setdefault(_key(f), []).append(f)
    groups: list[list[Table]] = []
    problems: list[str] = []
    for held in _with_references(files):
        tables: list[Table] = []
        logs = [f for f in dict.fromkeys(held) if not _names(f)]
        joints = _beside(held[0])
        for f in logs:
            try:
                tables += [replace(t, joints=t.joints or joints) for t in tables_of(f)]
            except GapError as error:
                problems.append(str(error))
        if tables:
            groups.append(with_time_file(tables))
        elif logs:
            problems.append(f"{logs[0]}: holds no table of numbers")
    if not groups:
        raise GapError(problems[0] if problems else "no log was found in what was given")
    return groups


def _inside(folder: Path) -> list[Path]:
    """Logs in a folder; what lies in a folder `meta` beside them tells of them and is none. Raises
    GapError if there are none, which says why of files that are not read.
    """
    found = sorted(f for f in folder.rglob("*") if f.is_file() and _is_log(f))
    told = {f.with_name("info.log") for f in found if dumped(f)}
    found = [f for f in found if f not in told]
    if not found:
        held = (folder, *sorted(folder.rglob("*")))
        refused = (f for f in held if f.suffix.lower() in REFUSED)
        for f in refused:
            tables_of(f)
        ends = ", ".join(e for group in SUFFIXES.values() for e in group)
        raise GapError(f"{folder}: the folder holds no log (files that end in {ends})")
    return [f for f in found if "meta" not in f.relative_to(folder).parts[:-1]] or found


def _with_references(files: Mapping[tuple[object, ...], list[Path]]) -> list[list[Path]]:
    """Files by run; a file of a folder whose name says nothing but that it is a reference goes to
    each run of that folder.
    """
    shared = {
        f.parent.resolve(): held
        for key, held in files.items()
        for f in held
        if len(key) == 1 and not f.is_dir() and all(stem_says(x.stem)[1] for x in held)
    }
    runs = [h for h in files.values() if h not in shared.values()]
    if not runs:
        return list(files.values())
    own = [h for h in shared.values() if h[0].parent.resolve() not in {_folder(r) for r in runs}]
    return [[*r, *shared.get(_folder(r), [])] for r in runs] + own


def _folder(run: Sequence[Path]) -> Path:
    return run[0].parent.resolve()


def _is_log(file: Path) -> bool:
    if not kind_of(file) or file.name.startswith((".", "README", "LICENSE")):
        return False
    return file.suffix != ".yaml" or holds_documents(file)


def _key(path: Path) -> tuple[object, ...]:
    if path.is_dir() or kind_of(path) == "bags":
        return (path,)
    if dumped(path):
        return (path.parent.parent.resolve(), *stem_key(path.parent.name))
    return (path.parent.resolve(), *stem_key(stem_of(path)))


def _names(file: Path) -> tuple[str, ...]:
    """Joint names of a small text file with a word a line."""
    if file.suffix not in {".txt", ".lst"} or not file.is_file() or file.stat().st_size > 4000:
        return ()
    try:
        lines = file.read_text(encoding="utf-8", errors="replace").split("\n")
    except OSError:
        return ()
    words = [w.strip() for w in lines if w.strip()]
    plain = all(len(w.split()) == 1 and "," not in w and not w[0].isdigit() for w in words)
    return tuple(words) if words and plain and "joint" in file.name.lower() else ()


def _beside(file: Path) -> tuple[str, ...]:
    folder = file.parent
    found = [n for f in sorted(folder.glob("*joint*.txt")) if (n := _names(f))]
    return found[0] if found else ()


def _runs(sources: Sequence[Source], request: Request) -> list[list[Source]]:
    """Tables of a group as runs: joined where one alone lacks something, else each by itself."""
    said = [stem_says(s.table.name) for s in sources]
    if len(sources) == 1:
        (source,) = sources
        named = source.table.headless and not request.silent  # the user says it, no file's name
        return [[source if named else with_stem(source, said[0][0], False)]]
    useful, wanted = [], []
    for source, (quantity, command) in zip(sources, said, strict=True):
        s = with_stem(source, quantity, False)
        if s.roles() or request.columns:
            useful.append(s)
            wanted.append(command)
    if not useful:
        return [list(sources)]
    useful[0] = _noted(useful[0], [s.table for s in sources], [s.table for s in useful])
    measured = [s for s, c in zip(useful, wanted, strict=True) if not c and "position" in s.roles()]
    if measured and any(wanted):
        useful = [
            with_stem(s, "", c and s not in measured) for s, c in zip(useful, wanted, strict=True)
        ]
    whole = [s for s in useful if {"position"} < s.roles()]
    same = len(whole) == len(useful) and not any(wanted)
    if same and not useful[0].table.of_one_run and not _complete_each_other(useful):
        return [[s] for s in useful]
    return [useful]


def _noted(first: Source, tables: Sequence[Table], used: Sequence[Table]) -> Source:
    """The first source of a run, with a note on the files beside it that say nothing."""
    names = {t.path.name for t in used}
    left = [t.path.name for t in tables if t.path.name not in names and t.size == used[0].size]
    if not left:
        return first
    said = f"{some_of(left)}: not used, as no name says a position, a velocity or an effort"
    return replace(first, table=replace(first.table, notes=(*first.table.notes, said)))


def _complete_each_other(sources: Sequence[Source]) -> bool:
    """Whether two tables are of as many joints and each has a signal that the other lacks: two
    topics of one robot, written to a file each.
    """
    if len(sources) != 2:
        return False
    joints = [{m.joint for m in s.meanings if m.role == "position"} for s in sources]
    one, other = (s.roles() for s in sources)
    return len(joints[0]) == len(joints[1]) and bool(one - other) and bool(other - one)


def _episodes(sources: list[Source]) -> list[list[Source]]:
    """A table of many episodes (or trials) as one run for each."""
    if len(sources) != 1:
        return [sources]
    source = sources[0]
    marks = [m.header for m in source.meanings if m.quantity == "episode"]
    if not marks:
        return [sources]
    which = np.round(source.table.columns[marks[0]])  # thinning may have averaged over an edge
    numbers = np.unique(which[np.isfinite(which)])
    if not 1 < numbers.size <= RUNS:
        return [sources]
    out = []
    for k in numbers:
        rows = which == k
        t = source.table
        columns = {h: c[rows] for h, c in t.columns.items()}
        texts = {h: [w for w, r in zip(v, rows, strict=True) if r] for h, v in t.texts.items()}
        cut = replace(t, columns=columns, texts=texts, name=f"{t.name} {k:g}")
        out.append([replace(source, table=cut)])
    return out


# -- which column is what ----------------------------------------------------------------------
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
    main = _main(sources)
    rows, t, clock = _clock(main, request, notes)
    kept = tuple(m for m in main.meanings if m.header != clock or m.role == "time")
    bare, said = replace(main, meanings=kept), ""
    if request.silent and len(sources) == 1:
        bare, said = in_blocks(bare, clock, rows, t)
        notes += [said] if said else []
    others = [s for s in sources if s is not main]
    sources = [bare, *sorted(others, key=_rank_of_efforts)]
    got: list[Column] = []
    for source in sources:
        got += _columns(source, bare, rows, t, request, notes, got)
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
    used = {(c.table, c.header) for c in taken}
    unused = [
        f"{s.table.name}: {h}" if len(sources) > 1 else h
        for s in sources
        for h in s.table.columns
        if (s.table.name, h) not in used and h not in clock
    ]
    said_once = tuple(dict.fromkeys(notes))
    return RobotRun(name, joints, tuple(taken), tuple(unused), said_once, clock, alike)


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


def _main(sources: Sequence[Source]) -> Source:
    """The table whose clock counts: the one with the most measured positions; of two with as many
    signals that which states their unit.
    """

    def worth(s: Source) -> tuple[int, int, int, int]:
        roles = [m.role for m in s.meanings]
        stated = sum(m.role == "position" and bool(m.unit) for m in s.meanings)
        driven = roles.count("error") + roles.count("effort")
        return roles.count("position"), driven, stated, s.table.size

    return max(sources, key=worth)


def _clock(main: Source, request: Request, notes: list[str]) -> tuple[Rows, Array, str]:
    if main.table.size < FEWEST:
        raise GapError(
            f"{main.table.path.name}: only {main.table.size} row(s); a log needs at least {FEWEST}"
        )
    stamps, header, _ = time_of(
        main.table, main.meanings, request.units.get("time", ""), request.rate, notes
    )
    placed = [
        main.table.columns[m.header]
        for m in main.meanings
        if m.role == "position" and m.header in main.table.columns
    ]
    if placed:  # rows that only other signals have (a merged export) give no grid
        shown = _shown([np.isfinite(p) for p in placed])
        stamps = stamps if shown is None else np.where(shown, stamps, math.nan)
    rows, t = ordered(stamps, notes)
    if t.size < FEWEST:
        raise GapError(
            f"{main.table.path.name}: only {t.size} rows with different time stamps in {header};"
            f" at least {FEWEST} are needed (--columns time=HEADER names another)"
        )
    return rows, t, header


def _shown(known: Sequence[NDArray[np.bool_]]) -> NDArray[np.bool_] | None:
    """Rows (n,) that hold the positions of joints, of which `known` says where each has one; None
    if all count. Of positions that stand in rows of their own, as several programs wrote them in
    turn, those count that fill most rows.
    """
    fullest = max(known, key=np.count_nonzero)
    in_turn = [k for k in known if k.any() and not np.any(k & fullest)]
    if in_turn:
        return fullest
    shown = np.any(known, axis=0)
    return shown if float(np.mean(shown)) < FULL and _sparse(shown) else None


def _sparse(shown: Array) -> bool:
    """Whether a column is filled now and then throughout, rather than missing for a while."""
    at = np.flatnonzero(shown)
    return at.size > 20 and float(np.median(np.diff(at))) > 1.0


def _columns(
    source: Source,
    main: Source,
    rows: Rows,
    t: Array,
    request: Request,
    notes: list[str],
    have: Sequence[Column],
) -> list[Column]:
    """Signals of one table on the main clock, without those that are there already."""
    kept = [m for m in source.meanings if m.role in SIGNALS and m.header in source.table.columns]
    if source is not main:
        joints = joints_of(have)
        taken = {(c.role, c.joint) for c in have if c.joint in joints}  # not places in arrays
        kept = [m for m in kept if (m.role, m.joint) not in taken]
        theirs = {m.joint for m in kept if m.role == "position"}
        there = {c.role for c in have}
        further = {"position", "command"} <= {m.role for m in kept} & there  # joints of their own
        if len(theirs) == len(joints) and not further:  # the same joints by other names
            kept = [m for m in kept if m.role not in there]
    places = [source.table.columns[m.header] for m in kept if m.role == "position"]
    if places and not any(map(still, places)):  # what stands still is no velocity of what moves
        kept = [
            m for m in kept if m.role != "velocity" or not still(source.table.columns[m.header])
        ]
    kept += _nameless(source)
    if not kept:
        return []
    made = []
    if source is main:
        whole = source.table.columns
        stamps = None
    else:
        declared = request.units.get("time", "")
        own, clock, _ = time_of(source.table, source.meanings, declared, request.rate, notes)
        kept = [m for m in kept if m.header != clock]
        order, stamps = ordered(own, notes)
        stamps = _aligned(stamps, t, source.table.path.name, notes)
        whole = {m.header: source.table.columns[m.header][order] for m in kept}
    for m in kept:
        y = whole[m.header]
        if stamps is not None:
            placed = onto(t, stamps, y)
        else:
            here = y[rows]
            sparse = not np.all(np.isfinite(here)) and np.isfinite(here).mean() < FULL
            placed = _filled(main, m, rows, t, request) if sparse else here
        made.append(_column(m, source.table, placed))
    return made


def _column(m: Meaning, table: Table, y: Array) -> Column:
    """A column's numbers (n,) with what it means; an effort's unit may be that of its name only."""
    stated = m.header in table.units or states(m.header, m.unit)
    guessed = m.quantity == "effort" and bool(m.unit) and not stated
    return Column(m.role, m.joint, m.header, table.name, m.unit, y, m.rank, guessed=guessed)


def _nameless(source: Source) -> list[Meaning]:
    """Columns of numbers that no word says anything of."""
    return [
        m
        for m in source.meanings
        if m.quantity == "other" and not m.command and not set(tokens(m.header)) & OTHER
        if m.header in source.table.columns and not still(source.table.columns[m.header])
    ]


def _filled(main: Source, m: Meaning, rows: Rows, t: Array, request: Request) -> Array:
    """A column that is filled now and then, between its own samples."""
    y = main.table.columns[m.header]
    known = np.isfinite(y)
    if not _sparse(known[rows]) and np.isfinite(y[rows]).mean() > 0.05:
        return np.asarray(y[rows])
    notes: list[str] = []
    declared, rate = request.units.get("time", ""), request.rate or 1.0
    stamps, _, _ = time_of(main.table, main.meanings, declared, rate, notes)
    both = known & np.isfinite(stamps)
    order = np.argsort(stamps[both], kind="stable")
    return onto(t, stamps[both][order], y[both][order])


def _aligned(stamps: Array, t: Array, name: str, notes: list[str]) -> Array:
    """Stamps of another file on the main clock: as they are if the two overlap, else from the same
    start.
    """
    shared = min(stamps[-1], t[-1]) - max(stamps[0], t[0])
    if shared > 0.5 * min(np.ptp(stamps), np.ptp(t)):
        return stamps
    notes.append(
        f"{name} has another clock ({stamps[0]:.6g} s against {t[0]:.6g} s at the start); both were"
        " set to start together, so a constant delay between the two says nothing"
    )
    return np.asarray(stamps - stamps[0] + t[0])
