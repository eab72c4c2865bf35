"""Tables in JSON: a list of records, records a line, columns by name, and what lies around them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pianobot_ros.axis.reading.formats.arrays.binary import from_arrays
from pianobot_ros.axis.reading.formats.arrays.rates import numeric, stated_rate
from pianobot_ros.axis.reading.formats.lines.values import of_rows
from pianobot_ros.axis.reading.formats.table import JOINTS, Table, expanded
from pianobot_ros.axis.reading.names import meaning
from pianobot_ros.gap.problem.errors import GapError
from pianobot_ros.gap.problem.types import Array

NAMES = {"name", "joint", "joint_name", "motor", "id"}


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
    if isinstance(held, Sequence) and not isinstance(held, str):
        if len(held) > 3 and all(isinstance(x, Mapping) for x in held[:20]):
            episodes = _episodes(path, name, held, rate)
            made.append(episodes or _records(path, name, held, rate))
        else:
            for k, inner in enumerate(held[:200]):
                if isinstance(inner, (Mapping, list)):
                    _search(path, f"{name} {k}", inner, made, rate)
    elif isinstance(held, Mapping):
        rate = stated_rate(held) or rate
        columns = {k: v for k, v in held.items() if numeric(v)}
        if columns:
            scalars = {k: v for k, v in held.items() if isinstance(v, (int, float))}
            named = {k: v for k, v in held.items() if _words(v)}
            tables = from_arrays(path, name, _arrays({**scalars, **columns}) | named)
            made += [replace(t, rate=t.rate or rate) for t in tables]
        for key, inner in held.items():
            if key not in columns and isinstance(inner, (Mapping, list)) and not _words(inner):
                own = name if key in {"entries", "data"} else f"{name} {key}"
                _search(path, own, inner, made, rate)


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


def _words(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(x, str) for x in value)


def _arrays(held: Mapping[str, Any]) -> dict[str, Any]:
    out = {}
    for key, value in held.items():
        try:
            out[key] = np.array(value, float)
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


def _flatten(label: str, value: Any, out: dict[str, Any]) -> None:
    """Objects in objects and lists as `a.b`, `a[0].b`; an object of a list that has a name goes by
    it (`joints[hip].q`).
    """
    if isinstance(value, Mapping):
        for key, inner in value.items():
            _flatten(f"{label}.{key}" if label else str(key), inner, out)
    elif isinstance(value, list) and len(value) <= JOINTS:
        for k, inner in enumerate(value):
            _flatten(f"{label}[{_called(inner) or k}]" if len(value) > 1 else label, inner, out)
    else:
        out[label] = value


def _called(value: Any) -> str:
    names = value if isinstance(value, Mapping) else {}
    return next((str(v) for k, v in names.items() if k.lower() in NAMES and isinstance(v, str)), "")
