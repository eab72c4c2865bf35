"""Between the wall clock, on which messages are stamped, and the monotonic clock, on which loops
wait.
"""

from __future__ import annotations

import time

__all__ = ["AHEAD", "WallClock", "wall_offset_ns"]

# s: a command stamped further ahead than this has another clock; no node obeys it
AHEAD = 0.2

_TRIES = 5
_RENEW = 1.0  # s after which the wall clock may have been set or slewed


def wall_offset_ns() -> int:
    """Wall time less monotonic time, ns. Of several readings the one that was disturbed least:
    between two calls a busy machine may take the processor away for a millisecond."""
    best, offset = 1 << 62, 0
    for _ in range(_TRIES):
        before = time.monotonic_ns()
        wall = time.time_ns()
        after = time.monotonic_ns()
        if after - before < best:
            best, offset = after - before, wall - (before + after) // 2
    return offset


class WallClock:
    """The offset between the clocks, measured once a second."""

    def __init__(self) -> None:
        self._offset, self._due = 0, 0.0

    def _renewed(self) -> int:
        now = time.monotonic()
        if now >= self._due:
            self._offset, self._due = wall_offset_ns(), now + _RENEW
        return self._offset

    def wall_ns(self, monotonic: float) -> int:
        """Wall time, ns since the epoch, of a monotonic time in s."""
        return round(1e9 * monotonic) + self._renewed()

    def monotonic(self, wall_ns: int) -> float:
        """Monotonic time, s, of a wall time in ns since the epoch."""
        return 1e-9 * (wall_ns - self._renewed())
