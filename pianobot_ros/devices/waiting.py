"""How long a device has said nothing, on a machine that may stand still itself."""

from __future__ import annotations

import time

__all__ = ["Waiting"]


class Waiting:
    """Time that a loop has spent waiting for something, without the time that it lost itself.

    A process that was kept from running, by other programs or by a machine that stood still, has
    heard nothing meanwhile; what was said waits to be read. So a turn of the loop counts for no
    longer than it takes when nothing holds it up.

    Args:
        turn: s that a turn of the loop takes at most when nothing holds it up.
    """

    def __init__(self, turn: float) -> None:
        self._turn = turn
        self.begin()

    def begin(self) -> None:
        """What was waited for has come, or is waited for from now on."""
        self.seconds = 0.0
        self._last = time.monotonic()

    def turn(self) -> float:
        """A turn of the loop has passed in vain; returns the time waited so far, s."""
        now = time.monotonic()
        self.seconds += min(now - self._last, self._turn)
        self._last = now
        return self.seconds
