"""Commands that wait for their time in the simulated cell."""

from __future__ import annotations

import heapq
import math
import threading
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from pianobot_ros.cell.arrays import Array

__all__ = ["AT_ONCE", "CommandQueue", "Stretch"]

AT_ONCE = -math.inf
"""When a command without a time of its own is due."""


class Stretch(NamedTuple):
    """Steps between which nothing but the wrist's setpoint changes: what is to be called before
    them, the setpoint (n, 6) in force in each, and that (6,) after them.
    """

    calls: list[Callable[[], None]]
    targets: Array
    after: Array


class CommandQueue:
    """What is due first comes first, then what was added first. Added to from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._count = 0
        self._waiting: list[tuple[float, int, Array | Callable[[], None]]] = []  # a heap

    def add(self, due: float, command: Array | Callable[[], None]) -> None:
        """A setpoint of the wrist (6,), or something to be called, at simulated time ``due``, s."""
        with self._lock:
            self._count += 1
            heapq.heappush(self._waiting, (due, self._count, command))

    def put_off(self, by: float) -> None:
        """Obey what waits so many s of simulated time later (earlier, if negative)."""
        with self._lock:  # the order stays
            self._waiting = [(due + by, count, command) for due, count, command in self._waiting]

    def clear(self) -> None:
        """Forget everything."""
        with self._lock:
            self._waiting.clear()

    def take(self, now: float, step: float, steps: int, target: Array) -> Stretch:
        """The next stretch, at most ``steps`` steps of ``step`` s from simulated time ``now`` on,
        each command obeyed at the step nearest to its time; the setpoint is ``target`` (6,) up to
        then.
        """
        calls: list[Callable[[], None]] = []
        places: list[tuple[int, Array]] = []
        with self._lock:
            while self._waiting:
                due, _, command = self._waiting[0]
                at = 0 if due <= now + 0.5 * step else max(1, round((due - now) / step))
                if at >= steps:
                    break
                if not callable(command):
                    places.append((at, command))
                elif at == 0:
                    calls.append(command)
                else:
                    steps = at
                    break
                heapq.heappop(self._waiting)
        targets = np.empty((steps, 6))
        targets[:] = after = target
        for at, after in places:
            targets[at:] = after
        return Stretch(calls, targets, after)
