"""Tables in JSON: a list of records, records a line, columns by name, and what lies around them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pianobot_ros.axis.reading.formats.binary import RATES, STEPS, from_arrays
from pianobot_ros.axis.reading.formats.table import Table, expanded
from pianobot_ros.axis.reading.formats.text import number, stamp
from pianobot_ros.axis.reading.names import tokens
from pianobot_ros.gap.problem.errors import GapError
from pianobot_ros.gap.problem.types import Array


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
        columns = {k: v for k, v in held.items() if _numeric(v)}
        if columns:
            scalars = {k: v for k, v in held.items() if isinstance(v, (int, float))}
            named = {k: v for k, v in held.items() if _words(v)}
            tables = from_arrays(path, name, _arrays({**scalars, **columns}) | named)
            made += [replace(t, rate=t.rate or rate) for t in tables]
        for key, inner in held.items():
            if key not in columns and isinstance(inner, (Mapping, list)) and not _words(inner):
                own = name if key in {"entries", "data"} else f"{name} {key}"
                _search(path, own, inner, made, rate)


def stated_rate(held: Mapping[str, Any]) -> float:
    """Hz that a mapping states (`action_hz: 50`, `dt: 0.02`), itself or in a part that holds
    settings only (`config`); 0 if none.
    """
    parts = [v for v in held.values() if isinstance(v, Mapping)]
    for part in (held, *(p for p in parts if not any(map(_numeric, p.values())))):
        for key, value in part.items():
            words = set(tokens(key))
            if not isinstance(value, (int, float)) or isinstance(value, bool) or value <= 0:
                continue
            if key.lower() in RATES or "hz" in words:
                return float(value)
            if key.lower() in STEPS:
                return 1.0 / value
    return 0.0


def _episodes(
    path: Path, name: str, held: Sequence[Mapping[str, Any]], rate: float
) -> Table | None:
    """Records that are each a run of its own, columns of one length in each, as one table."""
    keys = [k for k, v in held[0].items() if _numeric(v)]
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


def _records(path: Path, name: str, held: Sequence[Mapping[str, Any]], rate: float) -> Table:
    rows = [_flat("", r) for r in held if isinstance(r, Mapping)]
    columns, texts = {}, {}
    for key in dict.fromkeys(k for r in rows[:200] for k in r):
        values = [r.get(key) for r in rows]
        got = [_value(v) for v in values]
        if sum(v is not None for v in got) >= 0.3 * len(got):
            columns[key] = np.array([math.nan if v is None else v for v in got])
        elif all(isinstance(v, str) or v is None for v in values):
            texts[key] = [str(v) for v in values]
    return Table(path, name, columns, texts, rate=rate)


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
