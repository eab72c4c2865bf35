"""Every requirement of pyproject.toml, extras included."""

from __future__ import annotations

import re
from pathlib import Path


def requirements() -> list[str]:
    """The quoted strings of the dependency lists. Python 3.10 has no TOML reader, and the lists are
    plain.
    """
    text = Path("pyproject.toml").read_text(encoding="utf-8")
    head, _, rest = text.partition("[project.optional-dependencies]")
    return [
        *_quoted(head.partition("\ndependencies = [")[2].partition("\n]")[0]),
        *_quoted(rest.partition("\n[")[0]),
    ]


def _quoted(lines: str) -> list[str]:
    return re.findall(r'^\s*"([^"]+)",$', lines, flags=re.MULTILINE)
