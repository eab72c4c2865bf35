"""Print every requirement of pyproject.toml, extras included, one on a line, for pip; with the
argument ``messages`` only those that message packages are generated and compiled with.
"""

from __future__ import annotations

import re
import sys
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


def for_messages() -> list[str]:
    """Those of ROS, the extra `interfaces`, and numpy, of which generated messages hold arrays."""
    text = Path("pyproject.toml").read_text(encoding="utf-8")
    extra = _quoted(text.partition("\ninterfaces = [")[2].partition("\n]")[0])
    ours = [r for r in requirements() if r.startswith("ros-") or r == "numpy"]
    return list(dict.fromkeys([*ours, *extra]))


def _quoted(lines: str) -> list[str]:
    return re.findall(r'^\s*"([^"]+)",$', lines, flags=re.MULTILINE)


if __name__ == "__main__":
    print("\n".join(for_messages() if sys.argv[1:] == ["messages"] else requirements()))
