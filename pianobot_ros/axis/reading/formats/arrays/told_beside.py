"""What a JSON file beside arrays says of them: their rate, scales, and names of their columns."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from pianobot_ros.axis.reading.formats.arrays.rates import stated_rate
from pianobot_ros.axis.reading.formats.table import JOINTS, Table
from pianobot_ros.axis.reading.headers.meaning import meaning
from pianobot_ros.axis.reading.headers.words import tokens

__all__ = ["as_told_beside"]

LARGEST = 1_000_000
"""Bytes of a file that only tells of others."""


def as_told_beside(path: Path, tables: list[Table]) -> list[Table]:
    """Tables of arrays without a rate or with numbered columns, as a file beside them says: a list
    of names is of the columns of the only array that has as many, or, where its key says joints, of
    all that have; a list of numbers under `scale` of those of the array that is called so; which
    file that was is noted.
    """
    for file, told in _beside(path):
        rate, lists = stated_rate(told), list(_words(told))
        scales = list(_scales(told, frozenset()))
        made = [_told(_scaled(t, file.name, scales), file.name, rate, lists) for t in tables]
        made = [_jointed(t, file.name, _joints(told)) for t in made]
        if any(a is not b for a, b in zip(made, tables, strict=True)):
            return made
    return tables


def _beside(path: Path) -> Iterator[tuple[Path, Mapping[str, Any]]]:
    """Objects in JSON files of the folder: that of the file's own name, else those of no file's."""
    own = path.with_suffix(".json")
    logs = {f.stem for f in path.parent.iterdir() if f.suffix.lower() != ".json"}
    others = (f for f in sorted(path.parent.glob("*.json")) if f.stem not in logs)
    for file in [own] if own.is_file() else others:
        if file.stat().st_size > LARGEST:
            continue
        try:
            held = json.loads(file.read_text(encoding="utf-8-sig", errors="replace"))
        except (ValueError, RecursionError, OSError):
            continue
        if isinstance(held, Mapping) and not _samples(held):
            yield file, held


def _samples(held: Any) -> bool:
    """Whether it holds samples, and so is a log itself, whose rate is no other one's."""
    if isinstance(held, Mapping):
        return any(map(_samples, held.values()))
    return isinstance(held, list) and len(held) > JOINTS and not isinstance(held[0], str)


def _words(held: Any) -> Iterator[list[str]]:
    """Lists of names anywhere in it."""
    if isinstance(held, Mapping):
        for inner in held.values():
            yield from _words(inner)
    elif isinstance(held, list) and held and all(isinstance(x, str) for x in held):
        yield held


def _joints(held: Mapping[str, Any]) -> list[str]:
    """The only list of names under a key that says joints, [] if there are none or several."""
    keyed = {k: v for k, v in held.items() if "joint" in _singular(k)}
    found = [words for words in _words(keyed) if len(words) > 1]
    inner = [_joints(v) for v in held.values() if isinstance(v, Mapping)]
    found += [words for words in inner if words]
    return found[0] if found and all(words == found[0] for words in found) else []


def _jointed(table: Table, name: str, joints: Sequence[str]) -> Table:
    """A table whose joints are called so, where it has positions of as many without names."""
    wide = {
        len(heads)
        for array, heads in _arrays(table).items()
        if heads[0].startswith(f"{array}[") and meaning(heads[0]).role == "position"
    }
    if table.joints or table.headless or len(joints) not in wide:
        return table
    said = f"names of the joints as {name} beside the file says"
    return replace(table, joints=tuple(joints), notes=(*table.notes, said))


Scale = tuple[frozenset[str], list[float]]


def _scales(held: Mapping[str, Any], above: frozenset[str]) -> Iterator[Scale]:
    """Lists of numbers under a key like `scale`, with the words of all keys above them."""
    for key, inner in held.items():
        words = above | _singular(key)
        if isinstance(inner, Mapping):
            yield from _scales(inner, words)
        elif "scale" in words and isinstance(inner, list) and inner:
            numbers = [x for x in inner if isinstance(x, (int, float))]
            if len(numbers) == len(inner):
                yield words, numbers


def _singular(text: str) -> frozenset[str]:
    return frozenset(w.rstrip("s") for w in tokens(text))


def _scaled(table: Table, name: str, scales: list[Scale]) -> Table:
    columns = dict(table.columns)
    notes = []
    for array, headers in _arrays(table).items():
        for words, factors in scales:
            if _singular(array) <= words and len(factors) == len(headers):
                for header, factor in zip(headers, factors, strict=True):
                    columns[header] = factor * table.columns[header]
                listed = ", ".join(f"{x:g}" for x in factors)
                notes.append(f"{array} multiplied by {listed} as {name} beside the file says")
                break
    return replace(table, columns=columns, notes=(*table.notes, *notes)) if notes else table


def _arrays(table: Table) -> dict[str, list[str]]:
    """Headers of the columns of each array."""
    rows: dict[str, list[str]] = {}
    for header in table.columns:
        rows.setdefault(header.partition("[")[0], []).append(header)
    return rows


def _told(table: Table, name: str, rate: float, lists: list[list[str]]) -> Table:
    rows = _arrays(table)
    called: dict[str, str] = {}
    if table.headless:
        fits = [words for words in lists if len(words) == len(table.columns) > 1]
        if len(fits) == 1 and not table.joints:
            table = replace(
                table,
                joints=tuple(fits[0]),
                notes=(*table.notes, f"names of the joints as {name} beside the file says"),
            )
    for words in lists:
        alike = [held for held in rows.values() if len(held) == len(words) > 1]
        if len(alike) == 1 and sum(len(w) == len(words) for w in lists) == 1:
            called |= dict(zip(alike[0], words, strict=True))
    clear = len(set(called.values()) | (table.columns.keys() - called)) == len(table.columns)
    called = called if clear else {}
    if not called and (table.rate or not rate):
        return table
    said = (["names"] if called else []) + ([] if table.rate or not rate else [f"{rate:g} Hz"])
    return replace(
        table,
        columns={called.get(h, h): y for h, y in table.columns.items()},
        rate=table.rate or rate,
        notes=(*table.notes, f"{' and '.join(said)} as {name} beside the file says"),
    )
