"""What a file holds before anybody knows what it means: named columns of one length."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from pianobot_ros.gap.problem.types import Array

LARGE = 1_500_000
CELLS = 24_000_000
"""Rows and numbers of a table that are kept; a larger one is averaged in groups."""
RUNS = 400
"""Runs that one file may hold."""
JOINTS = 64
"""Joints that a robot may have."""
FEWEST = 20
"""Samples that a run needs."""
LARGEST = 1e24
"""What no reading reaches in any unit: a stamp in picoseconds since 1970 is 2e21."""


@dataclass(frozen=True)
class Table:
    """Columns of a file or a topic: header to values (n,), NaN where a value is none or beyond
    `LARGEST`; `texts` are columns of words.
    """

    path: Path
    name: str
    columns: Mapping[str, Array]
    texts: Mapping[str, Sequence[str]] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    """Units that the file states apart from its headers."""
    joints: tuple[str, ...] = ()
    """Names of the joints in the order of list-valued columns, where the file gives them."""
    rate: float = 0.0
    """Hz, where the file gives a rate instead of stamps."""
    notes: tuple[str, ...] = ()
    headless: bool = False
    """Whether the columns had no names and were numbered."""
    of_one_run: bool = False
    """Whether all tables of the file are of one run: topics of a bag, messages of a bus."""
    owners: Mapping[str, str] = field(default_factory=dict)
    """Joints that messages name, by the headers of what they say of them."""
    foreign: frozenset[str] = frozenset()
    """Headers of what is no joint's, whatever it is called, as the type of its message says."""
    clock: str = ""
    """Header of the stamps, where the reader knows them: no other column is a clock then."""
    robot: str = ""
    """Whose topic it is, where a recording is of several robots."""
    group: int = 1
    """How many rows of the file were averaged to one."""

    def __post_init__(self) -> None:
        """No door lets an infinite value in, nor one whose square no computation can hold."""
        object.__setattr__(self, "columns", {k: readings(y) for k, y in self.columns.items()})

    @property
    def size(self) -> int:
        """Number of rows."""
        return next((c.size for c in self.columns.values()), 0)


def stem_of(path: Path) -> str:
    """A file's name without its ending (`run_0.5.csv.gz` is run_0.5)."""
    name = path.name
    for _ in range(2 if name.lower().endswith(".gz") else 1):
        start, dot, end = name.rpartition(".")
        name = start if dot and start and end[:1].isalpha() else name
    return name


def some_of(names: Iterable[str], most: int = 20) -> str:
    """Names in one line, which says how many more there are."""
    held = list(names)
    more = f", … and {len(held) - most} more" if len(held) > most else ""
    return ", ".join(held[:most]) + more


def readings(y: Array) -> Array:
    """Values (n,) with NaN for what no reading can be."""
    with np.errstate(invalid="ignore"):
        beyond = ~(np.abs(y) < LARGEST)
    return np.where(beyond, np.nan, y) if beyond.any() else y


def expanded(name: str, values: Array) -> dict[str, Array]:
    """An array (n,), or (n, k) as k columns `name[0]`, …"""
    values = np.asarray(values)
    if values.ndim == 1:
        return {name: values}
    flat = values.reshape(values.shape[0], -1)
    if flat.shape[1] == 1:
        return {name: flat[:, 0]}
    return {f"{name}[{k}]": flat[:, k] for k in range(flat.shape[1])}


def grouped(path: Path, name: str, arrays: Mapping[str, Array], **extra: object) -> list[Table]:
    """Tables of arrays (n, …): one for each length n that occurs more than incidentally."""
    lengths: dict[int, dict[str, Array]] = {}
    for key, values in arrays.items():
        lengths.setdefault(values.shape[0], {}).update(expanded(key, values))
    made = []
    for n, columns in sorted(lengths.items(), reverse=True):
        if n >= 2:
            made.append(Table(path, name, columns, **extra))  # type: ignore[arg-type]
    return made


def group_of(rows: int, width: int) -> int:
    """How many rows are to be averaged to one, so that a table of that size is kept bounded."""
    return -(-rows // min(LARGE, max(CELLS // max(width, 1), 1)))


def averaged(columns: Mapping[str, Array], group: int, picked: bool = False) -> dict[str, Array]:
    """Columns (n,) as means of `group` rows each (n // group,), or (`picked`) the first of each."""
    if group <= 1:
        return dict(columns)
    out = {}
    for key, column in columns.items():
        blocks = column[: column.size // group * group].reshape(-1, group)
        known = np.isfinite(blocks)
        if picked:
            out[key] = blocks[:, 0].copy()
        elif known.all():
            out[key] = blocks.mean(1)
        else:
            count = known.sum(1)
            total = np.where(known, blocks, 0.0).sum(1)
            out[key] = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return out


def said(rows: int, group: int) -> str:
    """The note on a table that was thinned."""
    return f"{rows} rows were averaged in groups of {group} while reading"


def thinned(table: Table) -> Table:
    """The table with its rows averaged in groups, if it is larger than what is kept."""
    group = group_of(table.size, len(table.columns))
    if group <= 1 or table.texts:
        return table
    notes = (*table.notes, said(table.size, group))
    columns = averaged(table.columns, group)
    return replace(table, columns=columns, notes=notes, group=group * table.group)
