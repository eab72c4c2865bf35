"""Lines that are each an element of XML, as controllers send them: a row each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from xml.etree import ElementTree

from pianobot_ros.axis.reading.formats.lines.values import RECEIVED, number, stamp

__all__ = ["without_elements"]

LEAST = 0.4
"""Share of the lines that are alike: requests and answers may take turns."""


def without_elements(first: list[str], lines: Iterator[str]) -> tuple[list[str], Iterator[str]]:
    """Lines that are an element each (`<Rob><Pos A1="0.1" A2="3"/><T>12</T></Rob>`) as a header
    (`Pos.A1`, `Pos.A2`, `T`) and rows, where many have the same parts; others as they are.
    """
    parts = [tuple(_cells(x)) for x in first if x.strip()]
    usual = max(filter(None, parts), key=parts.count, default=())
    if len(usual) < 2 or parts.count(usual) < max(LEAST * len(parts), 2):
        return first, lines

    def bare(line: str) -> str:
        cells = _cells(line)
        return "\t".join(cells.values()) if tuple(cells) == usual else ""

    return ["\t".join(usual), *map(bare, first)], map(bare, lines)


def _cells(line: str) -> dict[str, str]:
    """Values of a line by their path in its element, and the stamp before it; {} if it is none."""
    ahead, _, rest = line.partition("<")
    if not rest or rest.startswith("!") or "<!" in rest:  # no entities: they may grow without end
        return {}
    try:
        element = ElementTree.fromstring(f"<{rest.strip()}")
    except (ElementTree.ParseError, ValueError):
        return {}
    out: dict[str, str] = {}
    when = ahead.strip(" \t[](){}->|,;")
    if when and (stamp(when) is not None or number(when) is not None):
        out[RECEIVED] = when
    _gather("", element, out)
    return out


def _gather(path: str, element: ElementTree.Element, out: dict[str, str]) -> None:
    for key, value in element.attrib.items():
        out[f"{path}.{key}" if path else key] = " ".join(value.split())
    if element.text and element.text.strip():
        out[path or element.tag] = " ".join(element.text.split())
    tags = [inner.tag for inner in element]
    for k, inner in enumerate(element):
        own = inner.tag if tags.count(inner.tag) == 1 else f"{inner.tag}[{_name(inner.attrib, k)}]"
        _gather(f"{path}.{own}" if path else own, inner, out)


def _name(attributes: Mapping[str, str], place: int) -> str:
    return attributes.get("name") or attributes.get("id") or str(place)
