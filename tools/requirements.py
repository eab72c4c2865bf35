"""Print every requirement of pyproject.toml, extras included, one on a line, for pip."""

from __future__ import annotations

import re
from pathlib import Path


def requirements() -> list[str]:
    """The quoted strings of the dependency lists. Python 3.10 has no TOML reader, and the lists are
    plain.
    """
    text = Path("pyproject.toml").read_text(encoding="utf-8")
    head, _, rest = text.partition("[project.optional-dependencies]")
    lists = [head.partition("\ndependencies = [")[2].partition("\n]")[0], rest.partition("\n[")[0]]
    return [
        match
        for part in lists
        for match in re.findall(r'^\s*"([^"]+)",$', part, flags=re.MULTILINE)
    ]


if __name__ == "__main__":
    print("\n".join(requirements()))
