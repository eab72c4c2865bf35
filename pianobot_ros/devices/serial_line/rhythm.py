"""Whether a device measures as it should: that this ends, or goes on, is an event."""

from __future__ import annotations

import time
from collections.abc import Callable

from pianobot_ros.devices.base import HealthLevel
from pianobot_ros.devices.serial_line.framing import LineStatistics
from pianobot_ros.devices.serial_line.opening import TURN
from pianobot_ros.devices.waiting import Waiting

__all__ = ["Rhythm"]

MISSED = 3.0  # measurements in a row after which they have ended


class Rhythm:
    """Follows the measurements of one link.

    Args:
        where: the link, for what is said.
        shortest: s without a measurement that are always borne.
        statistics: of the lines of the link.
        tell: called with a level and one line of text, once when measurements have ended and once
            when they go on.

    Attributes:
        period: s between two measurements; three that are missing are borne.
    """

    def __init__(
        self,
        where: str,
        shortest: float,
        statistics: LineStatistics,
        tell: Callable[[HealthLevel, str], None],
    ) -> None:
        self._where, self._shortest, self._tell = where, shortest, tell
        self._statistics = statistics
        self._last = float("-inf")
        self._missing = Waiting(TURN)
        self._ended = False
        self._broken = 0  # lines before the last measurement
        self.period = 0.0

    @property
    def age(self) -> float:
        """Time since the last measurement, s; infinite before the first."""
        return time.monotonic() - self._last

    @property
    def late(self) -> bool:
        """Whether the last measurement is too old."""
        return self.age > self._patience

    @property
    def _patience(self) -> float:
        return max(self._shortest, MISSED * self.period)

    def begin(self) -> None:
        """The link is open: measurements are to come from now on."""
        self._ended, self._broken = False, self._statistics.bad
        self._missing.begin()

    def came(self) -> None:
        """A measurement has come."""
        if self._ended:
            after = self._missing.turn()
            self._tell(HealthLevel.OK, f"{self._where}: measures again, after {after:.1f} s")
        self._last = time.monotonic()
        self.begin()

    def look(self) -> None:
        """A turn of the reading loop brought none."""
        missing = self._missing.turn()
        if self._ended or missing <= self._patience:
            return
        self._ended = True
        broken = self._statistics.bad - self._broken
        why = f"{broken} broken lines instead" if broken else "the device sends none"
        self._tell(HealthLevel.WARN, f"{self._where}: no measurement for {missing:.1f} s, {why}")
