"""The last guard before the controller: how far the arm may go in one of the controller's cycles.

The arm obeys once in a cycle, and then what it was given last. The driver's limiter counts on each
setpoint reaching it in its own time. Where two fall into one cycle, where streams fight, or where
this process or the stream was held up, what is given next would be a step that no limit knows of:
60 mm in a cycle after 100 ms. So each step is judged from where the arm was before the cycle; what
is more than the limits allow follows in the next ones. A stream that nothing disturbs passes
unchanged.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from pianobot_ros.devices.wrist.limits.approach import (
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


class Reach:
    """Follows what the arm was given: tool poses (6,), position m and rotation vector rad.

    Args:
        limits: speeds, accelerations and stale time.
        period: of the controller's cycles, s.
    """

    def __init__(self, limits: LimitsConfig, period: float) -> None:
        self._limits, self._period = limits, period
        self._cycle = -math.inf  # when the present one began, monotonic s
        self._start: Sequence[float] = ()  # where the arm was before it
        self._given: Sequence[float] = ()  # in it
        self._before = self._velocity = _STILL  # with which the arm came, and goes in it
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
        self._given, self._velocity, self._cycle = list(pose), _STILL, -math.inf

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
                shortened(
                    [d / step for d in turn(was[3:], pose[3:])], self._limits.angular_speed
                ),
            )
        self._asked = due, list(pose)

    def give(self, cycle: float) -> list[float]:
        """The pose to give the arm in the controller's cycle that began at ``cycle`` (monotonic s):
        what was asked for last, as far as the limits allow. A stream slower than the controller is
        given its steps in parts.
        """
        period, limits = self._period, self._limits
        since = cycle - self._cycle
        if since > 0.5 * period:
            left = max(0.0, 1.0 - max(0.0, since - period) / limits.stale)  # held as it was
            self._start, self._cycle = self._given, cycle
            velocity, rate = self._velocity
            self._before = [left * v for v in velocity], [left * w for w in rate]
        pose, start = self._asked[1], self._start
        share = 1.0 / max(1, self._cycles)
        (velocity, why), (rate, why_rotation) = bent(
            limits,
            (
                [share * d for d in difference(pose[:3], start[:3])],
                [share * d for d in turn(start[3:], pose[3:])],
            ),
            self._before,
            self._drift if self._cycles > 0 else _STILL,
            period,
        )
        self._cycles -= 1
        found = list(pose)
        if why or share < 1.0:
            found[:3] = moved(start[:3], velocity, period)
        if why_rotation or share < 1.0:
            found[3:] = turned(start[3:], rate, period)
        bound = bool(why or why_rotation)
        self.lag = math.dist(found[:3], pose[:3]) / limits.speed if bound else 0.0
        self._given, self._velocity = found, (velocity, rate)
        return found
