"""Whose fault it is that the controller's watchdog ended the program.

The program ends when no command has reached it for the watchdog's time. On a busy machine that is
this process's own delay, and the program may simply be started again: the arm is at rest, and only
fresh setpoints move it. A program that ended although it was fed in time was ended by somebody, or
by an error; that is for its user to look at.
"""

from __future__ import annotations

import math

__all__ = ["WatchdogFeed"]

_SHARE = 0.8  # of the watchdog's time; a silence that long may have been too long for it
_MEMORY = 0.5  # s after a late command within which a program that ended counts as starved


class WatchdogFeed:
    """When the watchdog was fed, and what the program did meanwhile. All times monotonic, s.

    Args:
        timeout: s without a command after which the controller ends the program.
    """

    def __init__(self, timeout: float) -> None:
        self._limit = _SHARE * timeout
        self._fed = self._late = -math.inf
        self._playing = False

    @property
    def fed(self) -> float:
        """When a command was last sent."""
        return self._fed

    def started(self, now: float) -> None:
        """The program was started, and its watchdog set."""
        self._fed, self._late, self._playing = now, -math.inf, True

    def feed(self, now: float) -> None:
        """A command was sent."""
        if now - self._fed > self._limit:
            self._late = now
        self._fed = now

    def starved(self, now: float, *, playing: bool, stopped: bool) -> bool:
        """Take note of a state of the program, noticed at ``now``; True if it says that the program
        has just ended for want of commands.

        A program that is neither (paused) is not watched, and once paused it is not this process
        that ends it.
        """
        if playing and not self._playing:
            self.started(now)
        ended = stopped and self._playing
        self._playing = playing
        return ended and (now - self._fed > self._limit or now - self._late < _MEMORY)
