"""What is known of a running or recorded cell, on one time axis: written by a node as it hears, or
once from a bag; read by the page as of a moment.
"""

from __future__ import annotations

import threading
from bisect import bisect_right
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Any

import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.recordings.keystroke import Keystroke, NoteEvent
from pianobot_ros.cell.recordings.recording import Strike

__all__ = ["CELLS", "STREAMS", "Fault", "GapTable", "Job", "StageGaps", "StrikeRow", "Tape"]

CELLS = ("real", "sim")
STREAMS = ("wrist/state", "vacuum/state", "fsr", "key_angle")
SILENT_AFTER = 0.5  # s without a message after which a stream counts as silent
_EMPTY: Array = np.empty(0)


@dataclass(frozen=True)
class StrikeRow:
    """A strike as compared: ``time`` s of its window's end; the keystrokes of both cells, None
    where the key did not sound; ``err`` of Eq. 5 as a fraction, NaN if either is missing;
    ``adopted`` what the twin that played it had adopted.
    """

    time: float
    start: float
    index: int
    note: int
    condition: str
    real: Keystroke | None
    sim: Keystroke | None
    err: float
    adopted: tuple[str, ...] = ()


@dataclass(frozen=True)
class GapTable:
    """Gap in floors: ``values`` (rows, columns), NaN where nothing was measured."""

    rows: tuple[str, ...]
    columns: tuple[str, ...]
    values: Array


@dataclass(frozen=True)
class StageGaps:
    """The gap by stage in floors at ``time`` s, after ``strike`` strikes of the tape."""

    time: float
    strike: int
    gaps: Mapping[str, float]
    table: GapTable | None = None


@dataclass(frozen=True)
class Job:
    """A diagnosis or investigation under way: what it does, ``progress`` 0 to 1, and the leading
    hypotheses with their probabilities."""

    time: float
    doing: str
    progress: float
    leading: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True)
class Fault:
    """Something that was not as it should be, from ``time`` to ``end`` s, in words."""

    time: float
    end: float
    text: str


@dataclass
class Tape:
    """``signals`` are named as in :class:`~pianobot_ros.cell.recordings.recording.Recording`. Times
    in s on an axis that begins at ``epoch`` s (wall time). ``memory`` s of samples are kept.
    ``remarks`` is what a bag's reader said. ``lock`` guards everything; the methods take it.
    """

    memory: float = float("inf")
    epoch: float = 0.0
    fsr_note: int | None = None
    notes: dict[str, list[NoteEvent]] = field(default_factory=lambda: {c: [] for c in CELLS})
    strikes: list[Strike] = field(default_factory=list)
    rows: list[StrikeRow] = field(default_factory=list)
    stages: list[StageGaps] = field(default_factory=list)
    verdicts: list[tuple[float, Mapping[str, Any]]] = field(default_factory=list)
    jobs: list[Job] = field(default_factory=list)
    faults: list[Fault] = field(default_factory=list)
    said: list[tuple[float, str]] = field(default_factory=list)
    remarks: tuple[str, ...] = ()
    report: str = ""
    lock: threading.RLock = field(default_factory=threading.RLock)
    _signals: dict[str, deque[tuple[Array, Array]]] = field(default_factory=dict)

    def add(self, name: str, time: Array, value: Array) -> None:
        """Samples of a signal: ``time`` (n,) increasing, ``value`` (n,) or (n, m)."""
        if not len(time):
            return
        with self.lock:
            chunks = self._signals.setdefault(name, deque())
            chunks.append((time, value))
            while chunks[0][0][-1] < time[-1] - self.memory:
                chunks.popleft()

    def note(self, cell: str, event: NoteEvent) -> None:
        """A note event of a cell."""
        with self.lock:
            events = self.notes[cell]
            events.append(event)
            if np.isfinite(self.memory) and len(events) > 4000:
                del events[:2000]

    def forget_samples(self) -> None:
        """Drop the samples, as when nobody has been looking for a while."""
        with self.lock:
            self._signals.clear()

    def names(self) -> list[str]:
        """The signals that were heard."""
        with self.lock:
            return list(self._signals)

    def window(self, name: str, start: float, end: float) -> tuple[Array, Array]:
        """Samples with start <= time <= end: times (n,) and values (n,) or (n, m)."""
        with self.lock:
            chunks = [
                c for c in self._signals.get(name, ()) if c[0][-1] >= start and c[0][0] <= end
            ]
        if not chunks:
            return _EMPTY, _EMPTY
        time = np.concatenate([c[0] for c in chunks]) if len(chunks) > 1 else chunks[0][0]
        value = np.concatenate([c[1] for c in chunks]) if len(chunks) > 1 else chunks[0][1]
        low, high = np.searchsorted(time, [start, end + 1e-12])
        return time[low:high], value[low:high]

    def latest(self, name: str, now: float) -> tuple[float, Any] | None:
        """Time and value of the last sample at or before ``now``, or None."""
        with self.lock:
            for time, value in reversed(self._signals.get(name, ())):
                if time[0] <= now:
                    i = int(np.searchsorted(time, now + 1e-12)) - 1
                    return float(time[i]), value[i]
        return None

    def silent_since(self, cell: str, stream: str, now: float) -> float | None:
        """When the last message of a silent stream came, s; None while it speaks; -inf if it was
        never heard.
        """
        with self.lock:
            names = [n for n in self._signals if n.startswith(f"{cell}/{stream}.")]
        last = -np.inf
        for name in names[:1]:
            found = self.latest(name, now)
            last = found[0] if found is not None else last
        return None if now - last < SILENT_AFTER else float(last)

    def sounding(self, cell: str, now: float) -> frozenset[int]:
        """The notes that sound."""
        down: set[int] = set()
        with self.lock:
            events = self.notes[cell]
            for event in events[-60:] if np.isfinite(self.memory) else self._near(events, now):
                if event.time > now:
                    break
                (down.add if event.on else down.discard)(event.note)
        return frozenset(down)

    def _near(self, events: Sequence[NoteEvent], now: float) -> Sequence[NoteEvent]:
        end = bisect_right(events, now, key=attrgetter("time"))
        return events[max(0, end - 60) : end]

    def until(self, now: float) -> tuple[list[StrikeRow], list[StageGaps]]:
        """Strikes compared and stage gaps seen up to ``now``."""
        with self.lock:
            return [r for r in self.rows if r.time <= now], [
                s for s in self.stages if s.time <= now
            ]
