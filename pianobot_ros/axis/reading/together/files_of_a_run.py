"""Which files, and which of their tables and rows, belong to one run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pianobot_ros.axis.reading.formats.files import REFUSED, SUFFIXES, kind_of, tables_of
from pianobot_ros.axis.reading.formats.lines.bottles import dumped
from pianobot_ros.axis.reading.formats.lines.echoed import holds_documents
from pianobot_ros.axis.reading.formats.table import RUNS, Table, some_of, stem_of
from pianobot_ros.axis.reading.formats.time_file import with_time_file
from pianobot_ros.axis.reading.headers.stems import stem_key, stem_says
from pianobot_ros.axis.reading.request import Request
from pianobot_ros.axis.reading.source import Source, with_stem
from pianobot_ros.gap.problem.errors import GapError


def groups_of(paths: Sequence[Path]) -> list[list[Table]]:
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


def runs_of(sources: Sequence[Source], request: Request) -> list[list[Source]]:
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


def episodes_of(sources: list[Source]) -> list[list[Source]]:
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
