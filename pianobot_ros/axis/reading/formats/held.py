"""What was read so far of a long file, with its memory bounded."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from pianobot_ros.axis.reading.formats.table import averaged, group_of, readings, said
from pianobot_ros.gap.problem.types import Array

__all__ = ["Held", "rows_of"]


def rows_of(columns: Mapping[str, Array]) -> int:
    """Number of rows of some columns."""
    return next((c.size for c in columns.values()), 0)


class Held:
    """What was parsed so far. When it gets too large, rows are averaged, two more to one."""

    def __init__(self, clocks: Sequence[str]) -> None:
        self.clocks = tuple(clocks)
        self.pieces: list[dict[str, Array]] = []
        self.texts: dict[str, list[str]] = {}
        self.rows, self.kept, self.group, self.shuffled = 0, 0, 1, False
        self.words: dict[str, str] = {}

    def add(self, numbers: dict[str, Array], texts: Mapping[str, Sequence[str]]) -> None:
        """The columns of another piece of the file."""
        numbers = {key: readings(y) for key, y in numbers.items()}
        for key, column in texts.items():  # each word once
            own = self.texts.setdefault(key, [])
            own.extend(self.words.setdefault(w, w) for w in column[:: self.group])
        self.rows += rows_of(numbers)
        for clock in self.clocks:
            step = np.diff(numbers[clock]) if clock in numbers else np.zeros(0)
            self.shuffled |= step.size > 0 and float(np.mean(step < 0)) > 0.1
        self.pieces.append(self._averaged(numbers, self.group))
        self.kept += rows_of(self.pieces[-1])
        joints = any(len(set(w)) > 1 for w in self.texts.values())  # rows are not of one thing
        if not joints and group_of(self.kept, len(numbers)) > 1:
            self.pieces = [self._averaged(p, 2) for p in self.pieces]
            self.texts = {k: w[::2] for k, w in self.texts.items()}
            self.kept = sum(rows_of(p) for p in self.pieces)
            self.group *= 2

    def _averaged(self, numbers: dict[str, Array], group: int) -> dict[str, Array]:
        """Means; but single rows of a file that is out of order, where means mix what is apart."""
        return averaged(numbers, group, self.shuffled)

    def notes(self) -> tuple[str, ...]:
        """What there is to say of the averaging."""
        return (said(self.rows, self.group),) if self.group > 1 else ()

    def columns(self) -> dict[str, Array]:
        """All columns (n,), NaN where a piece lacks one."""
        keys = dict.fromkeys(k for p in self.pieces for k in p)
        out = {}
        for key in keys:
            own = [p.pop(key, None) for p in self.pieces]
            rows = [
                next((c.size for c in (x, *p.values()) if c is not None), 0)
                for x, p in zip(own, self.pieces, strict=True)
            ]
            out[key] = np.concatenate(
                [np.full(n, math.nan) if x is None else x for x, n in zip(own, rows, strict=True)]
            )
        return out
