"""Lines whose every number has its label before it (`Time: 5 Position: 596`), which a stamp of the
program that wrote them may precede (`14:03:08.200 -> pos: 12.3`).
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from pianobot_ros.axis.reading.formats.lines.values import RECEIVED, comment

__all__ = ["without_labels"]

_LABELLED = re.compile(
    r"\s*([^\W\d_][^:=：,;|\t]{0,40}?)\s*[:=：]\s*"  # a label, of any script
    r"([-+]?(?:\d+(?:[.,]\d+)?|\.\d+)(?:[eE][-+]?\d+)?)"  # its number
    r"(?:\s*((?:[^\W\d_]|[°%/])+)(?=[\s,;|]|$)(?!\s*[:=：]))?\s*[,;|\t]?"  # its unit
)
_STAMP = (
    r"\s*[\[(]?("
    r"(?:\d{4}[-/.]\d\d[-/.]\d\d[ T])?(?:\d+:)?\d{1,2}:\d\d(?:[.,]\d+)?(?:Z|[-+]\d\d:?\d\d)?"
    r"|\d+(?:\.\d+)?"
    r")[\])]?\s*"
)
_BEFORE_LABEL = re.compile(_STAMP + r"(?:->|=>|[>|,;:])?(?=[\s\"]|[^\W\d_])")
_BEFORE_ROW = re.compile(_STAMP + r"(?:[-=]>|(?<=\s)>(?=\s))\s*")
_NUMBER = re.compile(r"(?:^|[\s,;|])[-+]?\.?\d")


def without_labels(first: list[str], lines: Iterator[str]) -> tuple[list[str], Iterator[str]]:
    """Lines whose every number has its label before it (`Time: 5 Position: 596`) as a header and
    rows of numbers, where nearly all have the same; others as they are, a stamp with an arrow as a
    cell of its own.
    """
    said = [_labelled(x) for x in first if x.strip() and not comment(x)]
    labels = [tuple(label for label, _, _ in x) for x in said]
    usual = max(labels, key=labels.count, default=())
    if len(usual) < 2 or labels.count(usual) < 0.8 * len(labels):
        return _without_arrows(first, lines)
    heads = [f"{label} [{unit}]" if unit else label for label, _, unit in said[labels.index(usual)]]

    def bare(line: str) -> str:
        found = _labelled(line)
        fits = tuple(label for label, _, _ in found) == usual
        return line if comment(line) else "\t".join(n for _, n, _ in found) if fits else ""

    return ["\t".join(heads), *map(bare, first)], map(bare, lines)


def _without_arrows(first: list[str], lines: Iterator[str]) -> tuple[list[str], Iterator[str]]:
    """Lines with the stamp before an arrow (`14:03:08.200 -> 12.3,12.5`) as their first cell."""
    rests = [x[m.end() :] for x in first if (m := _BEFORE_ROW.match(x))]
    if len(rests) < 0.8 * len(first):
        return first, lines
    separator = max(";\t|,", key=lambda c: sum(c in x for x in rests))
    if 2 * sum(separator in x for x in rests) < len(rests):
        separator = " "

    def split(line: str) -> str:
        m = _BEFORE_ROW.match(line)
        rest = line[m.end() :] if m else ""
        stamp = m[1] if m and _NUMBER.search(rest) else RECEIVED
        return f"{stamp}{separator}{rest}" if rest.strip() else ""

    return list(map(split, first)), map(split, lines)


def _labelled(line: str) -> tuple[tuple[str, str, str], ...]:
    """Label, number and unit of each number of a line, () if there is anything else in it."""
    found, at = [], 0
    text = line.strip()
    if ahead := _BEFORE_LABEL.match(text):
        found, at = [(RECEIVED, ahead[1], "")], ahead.end()
    while m := _LABELLED.match(text, at):
        found.append((m[1], m[2], m[3] or ""))
        at = m.end()
    return tuple(found) if at == len(text) else ()
