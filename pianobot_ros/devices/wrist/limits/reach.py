"""The last guard before the controller: how far the arm may go in one of the controller's cycles.

The arm obeys once in a cycle, and then what it was given last. The driver's limiter counts on each
setpoint reaching it in its own time. Where two fall into one cycle, where streams fight, or where
this process or the stream was held up, what is given next would be a step that no limit knows of:
60 mm in a cycle after 100 ms. So each step is judged from what the arm has surely obeyed, and from
whatever it may obey meanwhile, as one that is done in one cycle; what is more than the limits allow
follows in the next ones. A stream that nothing disturbs passes unchanged.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import TYPE_CHECKING

from pianobot_ros.devices.wrist.limits.approach import (
    TOLERANCE,
    Both,
    bent,
    difference,
    moved,
    shortened,
    turn,
    turned,
)

if TYPE_CHECKING:
    from pianobot_ros.devices.wrist.config import LimitsConfig

__all__ = ["Reach"]

_REST = (0.0, 0.0, 0.0)
_STILL: Both = (_REST, _REST)
_UNDER_WAY = 4e-4  # s that a pose takes to the controller, and the package that follows it back


class Reach:
    """Follows what the arm was given: tool poses (6,), position m and rotation vector rad.

    Args:
        limits: speeds, accelerations and stale time.
        period: of the controller's cycles, s.
    """

    def __init__(self, limits: LimitsConfig, period: float) -> None:
        self._limits, self._period = limits, period
        # When the arm was given what it has surely obeyed (monotonic s), that, and how fast it came
        # there; likewise what a later one may yet replace.
        self._obeyed: tuple[float, Sequence[float], Both] = (-math.inf, (), _STILL)
        self._open: deque[tuple[float, Sequence[float], Both]] = deque()
        self._given: Sequence[float] = ()
        self._asked: tuple[float, Sequence[float]] = (-math.inf, ())
        self._drift = _STILL  # of what is asked for
        self._cycles = 0  # until the stream's next pose is due
        self.lag = 0.0
        """s that the arm needs at full speed for the way that the limits keep it behind."""

    @property
    def short(self) -> bool:
        """Whether the arm was not yet given all of the way."""
        return self._given != self._asked[1]

    def rest(self, pose: Sequence[float]) -> None:
        """The arm stands at this pose."""
        self._given, self._obeyed = list(pose), (-math.inf, list(pose), _STILL)
        self._open.clear()

    def ask(self, pose: Sequence[float], due: float) -> None:
        """One more pose of the stream, of its time ``due`` (monotonic s), be it given or left
        out.
        """
        before, was = self._asked
        self._drift, self._cycles = _STILL, 1
        if 0.0 < due - before < self._limits.stale:
            step = max(due - before, self._period)
            self._cycles = int(step / self._period + 0.1)
            self._drift = (
                shortened([d / step for d in difference(pose[:3], was[:3])], self._limits.speed),
                shortened([d / step for d in turn(was[3:], pose[3:])], self._limits.angular_speed),
            )
        self._asked = due, list(pose)

    def give(self, now: float, cycle: float) -> list[float]:
        """The pose to give the arm at ``now``: what was asked for last, as far as the limits allow
        in one cycle; the newest that is known of began at ``cycle`` (both monotonic, s). A stream
        slower than the controller is given its steps in parts.
        """
        period, limits = self._period, self._limits
        while self._open and self._open[0][0] < cycle - _UNDER_WAY:
            self._obeyed = self._open.popleft()
        since, start, (was, spin) = self._obeyed
        left = max(0.0, 1.0 - max(0.0, cycle - since - period) / limits.stale)  # held as it was
        pose = self._asked[1]
        share = 1.0 / max(1, self._cycles)
        (velocity, why), (rate, why_rotation) = bent(
            limits,
            (
                [share * d for d in difference(pose[:3], start[:3])],
                [share * d for d in turn(start[3:], pose[3:])],
            ),
            ([left * v for v in was], [left * w for w in spin]),
            self._drift if self._cycles > 0 else _STILL,
            period,
        )
        self._cycles -= 1
        found = list(pose)
        if why or share < 1.0:
            found[:3] = moved(start[:3], velocity, period)
        if why_rotation or share < 1.0:
            found[3:] = turned(start[3:], rate, period)
        for _, place, _ in self._open:
            self._keep_near(found, place)
        bound = bool(why or why_rotation)
        self.lag = math.dist(found[:3], pose[:3]) / limits.speed if bound else 0.0
        self._given = found
        velocity = [d / period for d in difference(found[:3], start[:3])]
        rate = [d / period for d in turn(start[3:], found[3:])]
        self._open.append((now, found, (velocity, rate)))
        return found

    def _keep_near(self, pose: list[float], place: Sequence[float]) -> None:
        """Draw the pose to a place where the arm may be, so that one cycle may lead to it."""
        period, limits = self._period, self._limits
        way, swing = difference(pose[:3], place[:3]), turn(place[3:], pose[3:])
        if math.hypot(*way) > limits.speed * period * TOLERANCE:
            pose[:3] = moved(place[:3], shortened(way, limits.speed * period), 1.0)
        if math.hypot(*swing) > limits.angular_speed * period * TOLERANCE:
            pose[3:] = turned(place[3:], shortened(swing, limits.angular_speed * period), 1.0)
