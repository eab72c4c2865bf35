"""Lines whose every number has its label before it (`Time: 5 Position: 596`)."""

from __future__ import annotations

import re
from collections.abc import Iterator

from pianobot_ros.axis.reading.formats.lines.values import comment

__all__ = ["without_labels"]

_LABELLED = re.compile(
    r"\s*([A-Za-zµμ][^:=,;|\t]{0,40}?)\s*[:=]\s*"  # a label
    r"([-+]?(?:\d+(?:[.,]\d+)?|\.\d+)(?:[eE][-+]?\d+)?)"  # its number
    r"(?:\s*([A-Za-zµμ°%/]+)(?=[\s,;|]|$)(?!\s*[:=]))?\s*[,;|\t]?"  # its unit
)


def without_labels(first: list[str], lines: Iterator[str]) -> tuple[list[str], Iterator[str]]:
    """Lines whose every number has its label before it (`Time: 5 Position: 596`) as a header and
    rows of numbers, where nearly all have the same; others as they are.
    """
    said = [_labelled(x) for x in first if x.strip() and not comment(x)]
    labels = [tuple(label for label, _, _ in x) for x in said]
    usual = max(labels, key=labels.count, default=())
    if len(usual) < 2 or labels.count(usual) < 0.8 * len(labels):
        return first, lines
    heads = [f"{label} [{unit}]" if unit else label for label, _, unit in said[labels.index(usual)]]

    def bare(line: str) -> str:
        found = _labelled(line)
        fits = tuple(label for label, _, _ in found) == usual
        return line if comment(line) else "\t".join(n for _, n, _ in found) if fits else ""

    return ["\t".join(heads), *map(bare, first)], map(bare, lines)


def _labelled(line: str) -> tuple[tuple[str, str, str], ...]:
    """Label, number and unit of each number of a line, () if there is anything else in it."""
    found, at = [], 0
    text = line.strip()
    while m := _LABELLED.match(text, at):
        found.append((m[1], m[2], m[3] or ""))
        at = m.end()
    return tuple(found) if at == len(text) else ()
