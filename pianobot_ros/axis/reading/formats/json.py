"""Tables in JSON: a list of records, records a line, columns by name, and what lies around them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pianobot_ros.axis.reading.formats.binary import from_arrays
from pianobot_ros.axis.reading.formats.table import Table
from pianobot_ros.axis.reading.formats.text import number, stamp
from pianobot_ros.gap.problem.errors import GapError


def json_tables(path: Path) -> list[Table]:
    """Every list of records, or every set of columns, of a JSON file."""
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    try:
        held = json.loads(text, parse_int=float)
    except ValueError:
        held = _by_line(path, text)
    except RecursionError:
        raise GapError(f"{path.name}: is nested too deeply to be a log") from None
    made: list[Table] = []
    _search(path, path.stem, held, made)
    if not made:
        raise GapError(f"{path.name}: holds no list of records and no columns of numbers")
    return made


def _by_line(path: Path, text: str) -> list[Any]:
    out = []
    for line in text.splitlines():
        try:
            out.append(json.loads(line, parse_int=float))
        except (ValueError, RecursionError):
            continue
    if not out:
        raise GapError(f"{path.name}: is no JSON")
    return out


def _search(path: Path, name: str, held: Any, made: list[Table]) -> None:
    if isinstance(held, Sequence) and not isinstance(held, str):
        if len(held) > 3 and all(isinstance(x, Mapping) for x in held[:20]):
            made.append(_records(path, name, held))
        else:
            for k, inner in enumerate(held[:200]):
                if isinstance(inner, (Mapping, list)):
                    _search(path, f"{name} {k}", inner, made)
    elif isinstance(held, Mapping):
        columns = {k: v for k, v in held.items() if _numeric(v)}
        if columns:
            scalars = {k: v for k, v in held.items() if isinstance(v, (int, float))}
            named = {k: v for k, v in held.items() if _words(v)}
            made += from_arrays(path, name, _arrays({**scalars, **columns}) | named)
        for key, inner in held.items():
            if key not in columns and isinstance(inner, (Mapping, list)) and not _words(inner):
                _search(path, name if key in {"entries", "data"} else f"{name} {key}", inner, made)


def _numeric(value: Any) -> bool:
    if not isinstance(value, list) or len(value) < 4:
        return False
    return all(
        isinstance(x, (int, float)) or x is None or (isinstance(x, list) and x and _row(x))
        for x in value[:20]
    )


def _row(value: list[Any]) -> bool:
    return all(isinstance(x, (int, float)) for x in value)


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


def _records(path: Path, name: str, held: Sequence[Mapping[str, Any]]) -> Table:
    rows = [_flat("", r) for r in held if isinstance(r, Mapping)]
    columns, texts = {}, {}
    for key in dict.fromkeys(k for r in rows[:200] for k in r):
        values = [r.get(key) for r in rows]
        got = [_value(v) for v in values]
        if sum(v is not None for v in got) >= 0.3 * len(got):
            columns[key] = np.array([math.nan if v is None else v for v in got])
        elif all(isinstance(v, str) or v is None for v in values):
            texts[key] = [str(v) for v in values]
    return Table(path, name, columns, texts)


def _value(value: Any) -> float | None:
    if isinstance(value, (int, float)):
        return float(value)
    if isinstance(value, str):
        found = number(value)
        return stamp(value) if found is None else found
    return None


def _flat(prefix: str, record: Mapping[str, Any]) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for key, value in record.items():
        label = f"{prefix}.{key}" if prefix else str(key)
        if isinstance(value, Mapping):
            out.update(_flat(label, value))
        elif isinstance(value, list) and len(value) <= 64:
            for k, x in enumerate(value):
                out[f"{label}[{k}]" if len(value) > 1 else label] = x
        else:
            out[label] = value
    return out
