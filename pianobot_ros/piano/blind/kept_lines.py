"""Results of many hidden cells, a JSON object a line: a run that was ended goes on where it was."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

__all__ = ["add_line", "kept_lines", "write_table"]


def kept_lines(file: Path | None) -> list[dict[str, Any]]:
    """What earlier runs have left in ``file``; nothing without one."""
    if file is None or not file.exists():
        return []
    return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]


def add_line(lines: list[dict[str, Any]], line: dict[str, Any], file: Path | None) -> None:
    """Append a result to ``lines``, to the output and to ``file``, if given."""
    lines.append(line)
    text = json.dumps(line)
    print(text, flush=True)
    if file:
        with file.open("a", encoding="utf-8") as kept:
            kept.write(text + "\n")


def write_table(rows: Sequence[str], file: Path | None) -> None:
    """Print the table, and write it to ``file``, if given."""
    text = "\n".join(rows)
    print(f"\n{text}")
    if file:
        file.write_text(text + "\n", encoding="utf-8")
