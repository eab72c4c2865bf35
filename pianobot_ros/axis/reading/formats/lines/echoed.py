"""Messages as `ros2 topic echo` prints them: documents, or (`--csv`) values without headers."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import chain, islice
from pathlib import Path

import numpy as np

from pianobot_ros.axis.reading.formats.table import Table

__all__ = ["as_joint_state", "holds_documents", "without_documents"]

END = "---"
LONGEST = 20_000
"""Lines of a message."""
SEEN = 20
"""Messages from which their form is told."""
_OPENS = re.compile(r"^[A-Za-z_]\w*:\s*$")
_ENTRY = re.compile(r"^([A-Za-z_]\w*):(?:\s+(.*))?$")
ROLES = ("position", "velocity", "effort")


def as_joint_state(table: Table) -> Table:
    """The table with the headers of a JointState, if it looks like one: seconds and nanoseconds, a
    frame, the joints' names, then as many positions, velocities and efforts; else as it is.
    """
    if not table.headless or table.size < 2:
        return table
    heads = [f"column{k}" for k in range(len(table.columns) + len(table.texts))]
    words = [h for h in heads[3:] if h in table.texts and len(set(table.texts[h])) == 1]
    first = 3 + len(words)
    numbers = heads[first:]
    shares = len(numbers) // len(words) if words else 0
    if (
        words != heads[3:first]
        or not 1 <= shares <= len(ROLES)
        or len(numbers) != shares * len(words)
        or not all(h in table.columns for h in (*heads[:2], *numbers))  # no lists in cells
        or not _stamps(table)
    ):
        return table
    named = {f"{ROLES[k // len(words)]}[{k % len(words)}]": h for k, h in enumerate(numbers)}
    columns = {"sec": table.columns[heads[0]], "nanosec": table.columns[heads[1]]}
    columns |= {name: table.columns[h] for name, h in named.items()}
    note = f"no headers; taken as a JointState with {', '.join(ROLES[:shares])} of each joint"
    return replace(
        table,
        columns=columns,
        texts={},
        joints=tuple(table.texts[h][0] for h in words),
        notes=(*table.notes, note),
        headless=False,
    )


def _stamps(table: Table) -> bool:
    """Whether the first two columns are whole seconds and the nanoseconds beyond."""
    seconds, beyond = table.columns["column0"], table.columns["column1"]
    both = np.stack([seconds, beyond])
    return bool(
        np.all(both == np.round(both))
        and np.all(np.diff(seconds) >= 0)
        and np.all((beyond >= 0) & (beyond < 1e9))
        and float(np.max(beyond)) > 1e6
    )


def holds_documents(path: Path) -> bool:
    """Whether a file of YAML holds message after message, rather than settings."""
    with path.open(encoding="utf-8", errors="replace") as lines:
        return any(x.strip() == END for x in islice(lines, 1, LONGEST))


def without_documents(first: list[str], lines: Iterator[str]) -> tuple[list[str], Iterator[str]]:
    """Documents of YAML with `---` between them as a header (`header.stamp.sec`, `position[0]`) and
    a row for each that has the usual entries; others as they are.
    """
    if not _OPENS.match(next((x for x in first if x.strip() and x.strip() != END), "")):
        return first, lines
    more = first if any(x.strip() == END for x in first) else [*first, *islice(lines, LONGEST)]
    if not any(x.strip() == END for x in more):
        return more, lines
    documents = _documents(chain(more, lines))
    seen = list(islice(documents, SEEN))
    keys = [tuple(d) for d in seen]
    usual = max(keys, key=keys.count)
    rows = ("\t".join(d.values()) for d in chain(seen, documents) if tuple(d) == usual)
    return ["\t".join(usual), *islice(rows, SEEN)], rows


def _documents(lines: Iterable[str]) -> Iterator[dict[str, str]]:
    """The entries of each document by their path."""
    held: list[str] = []
    for line in chain(lines, [END]):
        if line.strip() != END:
            held.append(line)
            continue
        if found := _entries(held):
            yield found
        held = []


def _entries(lines: Iterable[str]) -> dict[str, str]:
    """What a document says by path: `a: {b: 1}` in lines of their own is `a.b`, an item `a[0]`."""
    out: dict[str, str] = {}
    above: list[tuple[float, str]] = []
    """The paths that a line may continue, with their indents."""
    count: dict[str, int] = {}
    for line in lines:
        text = line.strip()
        indent: float = len(line) - len(line.lstrip())
        while text == "-" or text.startswith("- "):  # an item stands below its list or beside it
            above = [(i, p) for i, p in above if i <= indent]
            path = above[-1][1] if above else ""
            k = count[path] = count.get(path, -1) + 1
            above.append((indent + 0.5, f"{path}[{k}]"))
            text, indent = text[1:].lstrip(), indent + 2
            if text and not text.startswith("- ") and not _ENTRY.match(text):
                out[above[-1][1]] = _plain(text)
        if entry := _ENTRY.match(text):
            above = [(i, p) for i, p in above if i < indent]
            path = f"{above[-1][1]}.{entry[1]}" if above else entry[1]
            above.append((indent, path))
            value = (entry[2] or "").strip()
            if value.startswith("["):
                items = filter(None, (x.strip() for x in value.strip("[]").split(",")))
                out.update((f"{path}[{k}]", _plain(x)) for k, x in enumerate(items))
            elif value:
                out[path] = _plain(value)
    return out


def _plain(value: str) -> str:
    return " ".join(value.strip("'\"").split())
