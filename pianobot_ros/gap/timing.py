"""Time that a computation used, as it would have been on a machine that has nothing else to do."""

from __future__ import annotations

import time

__all__ = ["Stopwatch"]

BUSY = 3.0  # a machine that runs other programs is believed to slow us down by at most this factor


class Stopwatch:
    """Started when made.

    :meth:`used` leaves out the time in which the machine ran something else (but never more than two thirds of the wall time), so
    that the same data get the same answer on a busy machine. With several threads the wall time bounds it; time of child
    processes is only seen through the wall time.
    """

    def __init__(self) -> None:
        self._wall, self._cpu = time.perf_counter(), time.process_time()

    def elapsed(self) -> float:
        """Wall seconds."""
        return time.perf_counter() - self._wall

    def used(self) -> float:
        """Seconds that count."""
        wall = self.elapsed()
        return max(min(time.process_time() - self._cpu, wall), wall / BUSY)
