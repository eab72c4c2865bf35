"""The last guard before the controller: how far the arm may go in a cycle when this process, or the
stream, was held up.

The driver's limiter counts on each setpoint reaching the arm in its own time. Where some did not,
the arm stands behind, and what it is given next would be a step that no limit knows of: 60 mm in a
cycle after 100 ms. From there it goes within the limits until it has caught up; a stream that
nothing held up passes unchanged.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from pianobot_ros.devices.wrist.limits.approach import (
    Both,
    Vector,
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
_LATE = 1.5  # times the stream's own step from which something was left out


class Reach:
    """Follows what the arm was given: tool poses (6,), position m and rotation vector rad.

    Args:
        limits: speeds, accelerations and stale time.
        period: of the controller's cycles, s.
    """

    def __init__(self, limits: LimitsConfig, period: float) -> None:
        self._limits, self._period = limits, period
        self._given: Sequence[float] = ()
        self._velocity: Vector = _REST
        self._rate: Vector = _REST
        self._time = -math.inf  # when the arm was given it, monotonic s
        self._due = -math.inf  # the stream's time that it was of
        self._asked: tuple[float, Sequence[float]] = (-math.inf, ())
        self._drift: Both = (_REST, _REST)  # of what is asked for
        self._step = period  # s between what is asked for, and what was asked for before
        self._behind = True
        self.lag = 0.0
        """s that the arm needs at full speed for the way that it is behind."""

    def rest(self, pose: Sequence[float], now: float) -> None:
        """The arm stands at this pose."""
        self._given, self._velocity, self._rate = list(pose), _REST, _REST
        self._time, self._behind = now - self._period, True

    def ask(self, pose: Sequence[float], due: float) -> None:
        """One more pose of the stream, of its time ``due`` (monotonic s), be it given or left
        out.
        """
        before, was = self._asked
        step = due - before
        self._drift, self._step = (_REST, _REST), self._period
        if 0.0 < step < self._limits.stale:
            self._step = step
            self._drift = (
                [d / step for d in difference(pose[:3], was[:3])],
                [d / step for d in turn(was[3:], pose[3:])],
            )
        self._asked = due, pose

    def give(self, now: float, *, late: bool = False) -> list[float]:
        """The pose to give the arm at ``now``: the last one that was asked for; where the arm is
        behind, or the stream is ``late`` and caught up with, what of the way the limits allow.
        """
        due, pose = self._asked
        usual = self._period if late else max(self._step, self._period)
        gap = now - self._time
        self._behind = self._behind or late or due - self._due > _LATE * usual
        dt = max(min(gap, usual), 0.1 * self._period)
        way, swing = difference(pose[:3], self._given[:3]), turn(self._given[3:], pose[3:])
        velocity: Vector = [d / usual for d in way]
        rate: Vector = [d / usual for d in swing]
        found = list(pose)
        if self._behind:
            limits = self._limits
            left = max(0.0, 1.0 - (gap - dt) / limits.stale)  # of its velocity, held as it was
            drift, spin = self._drift
            (velocity, why), (rate, why_rotation) = bent(
                limits,
                (way, swing),
                ([left * v for v in self._velocity], [left * w for w in self._rate]),
                (shortened(drift, limits.speed), shortened(spin, limits.angular_speed)),
                dt,
            )
            if why:
                found[:3] = moved(self._given[:3], velocity, dt)
            if why_rotation:
                found[3:] = turned(self._given[3:], rate, dt)
            self._behind = bool(why or why_rotation)
        self.lag = math.dist(found[:3], pose[:3]) / self._limits.speed if self._behind else 0.0
        self._given, self._velocity, self._rate = found, velocity, rate
        self._time, self._due = now, due
        return found
