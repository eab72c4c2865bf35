"""Messages of a bus as `cantools decode` prints what `candump` heard: the stamp, the frame, `::`,
then the message's name and its signals with their units, on one line or on one for each signal.
"""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

import numpy as np

from pianobot_ros.axis.reading.formats.lines.values import comment, number, value
from pianobot_ros.axis.reading.formats.table import Table
from pianobot_ros.axis.reading.headers.vocabulary import OTHER

__all__ = ["messages"]

SEEN, FEWEST = 40, 2
"""Lines among which there must be so many messages: one may take some lines."""
LONGEST = 20_000
"""Characters of a message."""
_MESSAGE = re.compile(r"^\s*(?:\(([^()]*)\))?[^:]*::\s*(\w+)\(\s*(.*?),?\s*\)\s*$")
_SIGNAL = re.compile(r"(\w+):\s*(?:'[^']*'|\"[^\"]*\"|([^\s,]+)(?:[ ]+([^\s,]+))?)\s*(?:,|$)")


@dataclass
class _Heard:
    """What was heard of one message: stamps in s (NaN where there are none), and its signals by
    their headers.
    """

    times: array[float] = field(default_factory=lambda: array("d"))
    signals: dict[str, array[float]] = field(default_factory=dict)

    def add(self, when: float, said: Mapping[str, float]) -> None:
        """Once more the message; a signal that it lacks (it may be multiplexed) is NaN."""
        for header in said:
            if header not in self.signals:
                self.signals[header] = array("d", [math.nan]) * len(self.times)
        self.times.append(when)
        for header, values in self.signals.items():
            values.append(said.get(header, math.nan))


def messages(path: Path, name: str, first: list[str], lines: Iterator[str]) -> list[Table]:
    """A table for each message of a decoded log of a bus, its signals called by the message's name
    too; [] if these lines are none, of which none is taken then.
    """
    begun = (x for x in first[:SEEN] if not comment(x))
    if sum(_parts(x) is not None for x in _whole(begun)) < FEWEST:
        return []
    heard: dict[str, _Heard] = {}
    for line in _whole(chain(first, lines)):
        if parts := _parts(line):
            when, message, said = parts
            heard.setdefault(message, _Heard()).add(when, said)
    made = []
    for own in heard.values():
        times = np.array(own.times)
        clock = {"time": times} if np.isfinite(times).any() else {}
        columns = {h: np.array(y) for h, y in own.signals.items()}
        made.append(Table(path, name, clock | columns, of_one_run=True))
    return made


def _whole(lines: Iterable[str]) -> Iterator[str]:
    """Messages on a line each."""
    held = ""
    for line in lines:
        text = line.strip()
        held = text if "::" in text else f"{held} {text}" if held else ""
        if held.endswith(")"):
            yield held
        if held.endswith(")") or len(held) > LONGEST:
            held = ""


def _parts(line: str) -> tuple[float, str, dict[str, float]] | None:
    """Stamp, name and numbers of a message; None if it is none or holds no number."""
    m = _MESSAGE.match(line)
    if m is None:
        return None
    own = "_".join(w for w in m[2].split("_") if w.lower() not in OTHER)
    said = {}
    for signal, cell, unit in _SIGNAL.findall(m[3]):
        if cell and (y := number(cell)) is not None:
            said[f"{own}.{signal} [{unit}]" if unit else f"{own}.{signal}"] = y
    when = value(m[1] or "")
    return (math.nan if when is None else when, m[2], said) if said else None
