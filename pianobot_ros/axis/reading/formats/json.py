"""Tables in JSON: a list of records, records a line, columns by name, and what lies around them.

What pandas writes (`to_json`, its `orient`) is read in each form: records, columns (an object of
values by row for each column), index (an object for each row), split (names beside rows), values.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from pianobot_ros.axis.reading.formats.arrays.binary import from_arrays
from pianobot_ros.axis.reading.formats.arrays.rates import numeric, stated_rate
from pianobot_ros.axis.reading.formats.lines.values import RECEIVED, of_rows, value
from pianobot_ros.axis.reading.formats.table import JOINTS, RUNS, Table, expanded
from pianobot_ros.axis.reading.headers.meaning import meaning
from pianobot_ros.gap.problem.errors import GapError
from pianobot_ros.gap.problem.types import Array

NAMES = {"name", "joint", "joint_name", "motor", "id"}
MESSAGE = ("data", "message", "msg", "payload")
"""Keys under which a record holds a topic's message."""
JOINT_STATE = {"name", "position", "velocity", "effort"}
"""Fields of ROS' `JointState`, whose positions are in rad by its definition."""
FEW = 4
"""Rows that tell what a list or an object is of."""


def json_tables(path: Path) -> list[Table]:
    """Every list of records, or every set of columns, of a JSON file."""
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    notes: tuple[str, ...] = ()
    try:
        held = json.loads(text, parse_int=float)
    except ValueError:
        held, notes = _by_line(path, text)
    except RecursionError:
        raise GapError(f"{path.name}: is nested too deeply to be a log") from None
    made: list[Table] = []
    _search(path, path.stem, held, made)
    if not made:
        raise GapError(f"{path.name}: holds no list of records and no columns of numbers")
    return [replace(t, notes=(*t.notes, *notes)) for t in made]


def message_tables(path: Path, topic: str, messages: Sequence[Mapping[str, Any]]) -> list[Table]:
    """The table of a topic's messages, which are objects of JSON."""
    made: list[Table] = []
    _search(path, topic.strip("/"), messages, made)
    in_rad = messages[0].keys() >= JOINT_STATE
    units = [
        {h: "rad" for h in t.columns if in_rad and h.partition("[")[0] == "position"} for t in made
    ]
    return [
        replace(t, of_one_run=True, units={**t.units, **own})
        for t, own in zip(made, units, strict=True)
    ]


def _by_line(path: Path, text: str) -> tuple[list[Any], tuple[str, ...]]:
    """What each line holds, and a note on those that are no JSON: a last one may be cut off."""
    out = []
    lines = [line for line in text.splitlines() if line.strip()]
    for line in lines:
        try:
            out.append(json.loads(line, parse_int=float))
        except (ValueError, RecursionError):
            continue
    if not out:
        raise GapError(f"{path.name}: is no JSON")
    left = len(lines) - len(out)
    said = f"{left} of {len(lines)} lines are no JSON (a last one may be cut off); left out"
    return out, (said,) if left else ()


def _search(path: Path, name: str, held: Any, made: list[Table], rate: float = 0.0) -> None:
    """Every table in it; ``rate``: Hz that is stated further out, 0 if none."""
    held = _unkeyed(held)
    if isinstance(held, Sequence) and not isinstance(held, str):
        if len(held) >= FEW and all(isinstance(x, Mapping) for x in held[:20]):
            made += _of_records(path, name, held, rate)
        elif _matrix(held):
            made += _matrix_tables(path, name, held, rate)
        else:
            for k, inner in enumerate(held[:200]):
                if isinstance(inner, (Mapping, list)):
                    _search(path, f"{name} {k}", inner, made, rate)
    elif isinstance(held, Mapping):
        rate = stated_rate(held) or rate
        if split := _split(held):
            made += _matrix_tables(path, name, split, rate)
            return
        columns = {k: v for k, v in held.items() if numeric(v)}
        if columns:
            scalars = {k: v for k, v in held.items() if isinstance(v, (int, float))}
            named = {k: v for k, v in held.items() if _words(v)}
            tables = from_arrays(path, name, _arrays({**scalars, **columns}) | named)
            made += [replace(t, rate=t.rate or rate) for t in tables]
        for key, inner in islice(held.items(), RUNS):
            if key not in columns and isinstance(inner, (Mapping, list)) and not _words(inner):
                own = name if key in {"entries", "data"} else f"{name} {key}"
                _search(path, own, inner, made, rate)


def _of_records(
    path: Path, name: str, held: Sequence[Mapping[str, Any]], rate: float
) -> list[Table]:
    """The tables of records: one for each topic, or one of all."""
    if topics := _topics(held):
        return [t for topic, own in topics.items() for t in message_tables(path, topic, own)]
    return [_episodes(path, name, held, rate) or _records(path, name, held, rate)]


def _topics(held: Sequence[Any]) -> dict[str, list[Mapping[str, Any]]]:
    """Messages by topic of records that each hold one, as `mcap cat --json` and rosbridge write
    them, with when it was received; {} where records hold something else.
    """
    made: dict[str, list[Mapping[str, Any]]] = {}
    for record in held:
        topic = record.get("topic") if isinstance(record, Mapping) else None
        inner = [record[k] for k in MESSAGE if k in record] if isinstance(topic, str) else []
        if not inner or not isinstance(inner[0], Mapping):
            return {}
        times = (v for k, v in record.items() if meaning(k).quantity == "time")
        stamp = next((v for v in times if value(v) is not None), None)
        received = {} if stamp is None else {RECEIVED: stamp}
        made.setdefault(str(topic), []).append({**received, **inner[0]})
    return made


def _unkeyed(held: Any) -> Any:
    """What is held, but for objects whose keys count rows: their values in a list, with the keys as
    time where they are no plain numbering.
    """
    if not isinstance(held, Mapping) or not held:
        return held
    inner = list(held.values())
    if all(isinstance(v, Mapping) and len(v) >= FEW for v in inner) and all(
        _counted(v) and v.keys() == inner[0].keys() and not _nested(v) for v in inner
    ):
        return {k: list(v.values()) for k, v in held.items()}
    if len(held) < FEW or not _counted(held) or not all(isinstance(v, Mapping) for v in inner):
        return held
    keys = [value(k) for k in held]
    plain = keys == list(map(float, range(int(keys[0] or 0), int(keys[0] or 0) + len(keys))))
    return inner if plain else [{"time": k, **v} for k, v in zip(keys, inner, strict=True)]


def _counted(held: Mapping[str, Any]) -> bool:
    """Whether the keys of an object are numbers or stamps, which no names are."""
    return all(value(k) is not None for k in held)


def _nested(held: Mapping[str, Any]) -> bool:
    return any(isinstance(v, (Mapping, list)) for v in islice(held.values(), 20))


def _matrix(held: Sequence[Any]) -> bool:
    """Whether a list holds rows of numbers, stamps or, in the first one, names."""
    if len(held) < FEW or not isinstance(held[0], list) or len(held[0]) < 2:
        return False
    width = len(held[0])
    flat = all(isinstance(r, list) and len(r) == width for r in held)
    return flat and all(value(x) is not None or x is None for r in held[1:20] for x in r)


def _split(held: Mapping[str, Any]) -> list[Any]:
    """Rows beside the names of their columns, as one list that begins with the names; else []."""
    rows = [v for v in held.values() if isinstance(v, list) and _matrix(v)]
    for names in (v for v in held.values() if _words(v)) if len(rows) == 1 else ():
        says = any(meaning(n).role not in {"other", "position"} for n in names)
        if says and len(names) == len(rows[0][0]):
            return [names, *rows[0]]
    return []


def _matrix_tables(path: Path, name: str, held: Sequence[Any], rate: float) -> list[Table]:
    """The table of rows; their names are the first one, or there are none."""
    if _words(held[0]) and not all(value(x) is not None for x in held[0]):
        return [of_rows(path, name, [dict(zip(held[0], r, strict=True)) for r in held[1:]], rate)]
    array = np.array([[value(x) for x in r] for r in held], float)
    columns = {f"column{k}": array[:, k] for k in range(array.shape[1])}
    return [Table(path, name, columns, rate=rate, headless=True)]


def _episodes(
    path: Path, name: str, held: Sequence[Mapping[str, Any]], rate: float
) -> Table | None:
    """Records that are each a run of its own, columns of one length in each, as one table."""
    keys = [k for k, v in held[0].items() if numeric(v)]
    if _samples(held, keys):
        return None
    runs = [[v for k in keys if isinstance(v := record.get(k), list)] for record in held]
    good = [run for run in runs if len(run) == len(keys) and len({len(v) for v in run}) == 1]
    if len(good) < 0.5 * len(held):
        return None
    columns: dict[str, Array] = {}
    for key, values in zip(keys, zip(*good, strict=True), strict=True):
        try:
            columns.update(expanded(key, np.concatenate([np.array(v, float) for v in values])))
        except (ValueError, TypeError):
            continue
    lengths = [len(run[0]) for run in good]
    columns["episode"] = np.repeat(np.arange(len(good), dtype=float), lengths)
    left = len(held) - len(good)
    notes = (f"{left} of {len(held)} runs have columns of several lengths; left out",)
    return Table(path, name, columns, rate=rate, notes=notes if left else ())


def _samples(held: Sequence[Mapping[str, Any]], keys: Sequence[str]) -> bool:
    """Whether records are samples, whose lists are of joints: short ones, of one length throughout,
    and fewer than there are records.
    """
    if any(meaning(k).quantity == "time" for k in keys):
        return False
    long = {len(v) for record in held for k in keys if isinstance(v := record.get(k), list)}
    return max(long, default=0) <= min(JOINTS, len(held) - 1) and all(
        len({len(v) for record in held if isinstance(v := record.get(k), list)}) == 1 for k in keys
    )


def _words(held: Any) -> bool:
    return isinstance(held, list) and bool(held) and all(isinstance(x, str) for x in held)


def _arrays(held: Mapping[str, Any]) -> dict[str, Any]:
    out = {}
    for key, numbers in held.items():
        try:
            out[key] = np.array(numbers, float)
        except (ValueError, TypeError):
            continue
    return out


def _records(path: Path, name: str, held: Sequence[Mapping[str, Any]], rate: float) -> Table:
    rows: list[dict[str, Any]] = []
    for record in held:
        if isinstance(record, Mapping):
            rows.append({})
            _flatten("", record, rows[-1])
    return of_rows(path, name, rows, rate)


def _flatten(label: str, held: Any, out: dict[str, Any]) -> None:
    """Objects in objects and lists as `a.b`, `a[0].b`; an object of a list that has a name goes by
    it (`joints[hip].q`).
    """
    if isinstance(held, Mapping):
        for key, inner in held.items():
            _flatten(f"{label}.{key}" if label else str(key), inner, out)
    elif isinstance(held, list) and len(held) <= JOINTS:
        for k, inner in enumerate(held):
            _flatten(f"{label}[{_called(inner) or k}]" if len(held) > 1 else label, inner, out)
    else:
        out[label] = held


def _called(held: Any) -> str:
    names = held if isinstance(held, Mapping) else {}
    return next((str(v) for k, v in names.items() if k.lower() in NAMES and isinstance(v, str)), "")
