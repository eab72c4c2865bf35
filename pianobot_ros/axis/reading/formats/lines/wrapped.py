"""Numbers that stand in what Python prints around them: `np.float64(1.23)`, as NumPy 2 shows its
scalars, `array([1., 2.], dtype=float32)`, `tensor(0.5, device='cuda:0')`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

__all__ = ["without_wrappers"]

_NAMES = r"(?:np|numpy|torch|jnp)\.\w+|array|Array|tensor|deque"
_WRAPPED = re.compile(
    rf"(?<![\w.])(?:{_NAMES})\(\s*([^()\[\]]*?|\[[^()]*?\])\s*(?:,\s*[a-z_]+=[^()]*?)?\)"
)
DEEPEST = 4
"""Wrappers around one number: an array of scalars in a list, say."""


def without_wrappers(first: list[str], lines: Iterator[str]) -> tuple[list[str], Iterator[str]]:
    """Lines without what Python prints around numbers, where lines have it."""
    if not any(_WRAPPED.search(x) for x in first):
        return first, lines
    return list(map(_bare, first)), map(_bare, lines)


def _bare(line: str) -> str:
    for _ in range(DEEPEST):
        line, found = _WRAPPED.subn(_inside, line)
        if not found:
            break
    return line


def _inside(found: re.Match[str]) -> str:
    """The number or the list within, without a keyword behind it."""
    held = found[1]
    return held if held.startswith("[") else re.split(r",\s*[a-z_]+=", held)[0]
