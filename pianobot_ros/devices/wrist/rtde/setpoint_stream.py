"""Setpoints that arrive ahead of their time, and what of them is sent in each of the controller's
cycles.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

from pianobot_ros.devices.wrist.messages import Setpoint

__all__ = ["CATCH_UP", "CycleClock", "SetpointStream"]

_LONGEST = 0.1  # s between two setpoints beyond which there is no path between them
CATCH_UP = 1.5  # times its pace at which a stream that fell behind is followed
_JUMP = 0.004  # s; a cycle that comes too early by more is no drift
_PATIENCE = (
    0.5  # s of lateness by more than that after which the controller must have skipped cycles
)
# share of a cycle's lateness that the clock takes over: the clocks drift, but most lateness is
# jitter
_FOLLOW = 0.002


class CycleClock:
    """The controller's cycles on this machine's monotonic clock, free of the jitter with which its
    packages are noticed.

    A package can be noticed late but never early, so the clock follows the earliest.
    """

    def __init__(self) -> None:
        self._offset: float | None = None
        self._punctual = 0.0  # when a package was last not far too late
        self.newest = -math.inf
        """The newest cycle, monotonic s."""

    def read(self, now: float, stamp: float) -> float:
        """Monotonic time of the cycle whose package has the controller's time ``stamp`` and was
        noticed at ``now``, s.
        """
        offset = now - stamp
        late = math.inf if self._offset is None else offset - self._offset
        if self._offset is not None and late <= _JUMP:
            self._punctual = now
        if self._offset is None or late < -_JUMP or now - self._punctual > _PATIENCE:
            self._offset, self._punctual = offset, now
        else:
            self._offset += (_FOLLOW if late > 0.0 else 0.5) * min(late, _JUMP)
        self.newest = stamp + self._offset
        return self.newest


class SetpointStream:
    """Tool poses (6,) with the times at which the arm is to be given them.

    Between two of them the pose goes along a cubic through its neighbours (Catmull-Rom), so that it
    does not matter where in the stream's grid the controller's cycles fall.
    """

    def __init__(self) -> None:
        self._knots: deque[tuple[float, list[float], Setpoint]] = deque(maxlen=256)
        self.given = math.inf
        """Up to where of its time the arm was given it, monotonic s."""
        self.behind = 0.0
        """s by which the arm was last given its path after the path's time."""

    def __bool__(self) -> bool:
        return bool(self._knots)

    @property
    def end(self) -> float:
        """When the last setpoint is due, monotonic s; minus infinity without one."""
        return self._knots[-1][0] if self._knots else -math.inf

    def clear(self) -> None:
        """Forget everything."""
        self._knots.clear()
        self.given, self.behind = math.inf, 0.0

    def add(self, setpoint: Setpoint) -> None:
        """One more setpoint; those that were to come later than it are dropped."""
        while self._knots and self._knots[-1][0] >= setpoint.due - 1e-4:
            self._knots.pop()
        pose = list(setpoint.pose)
        if self._knots:
            pose[3:] = _nearest(pose[3:], self._knots[-1][1][3:])
        self._knots.append((setpoint.due, pose, setpoint))

    def follow(self, time: float, period: float) -> Setpoint | None:
        """What the arm is to be given in the cycle of ``period`` s that is at ``time`` (monotonic
        s); None before the first setpoint.

        Who was held up, or whose setpoints came late, catches up along the path: the arm held
        meanwhile, and a step to where it should be would be faster than any joint can go.
        """
        if self._knots:
            wanted = min(time, self.end)
            if time > self.given + CATCH_UP * period:
                time = min(time, max(self.given, self._hole()) + CATCH_UP * period)
            self.behind = max(0.0, wanted - time)
        found = self.at(time)
        if found is not None:
            self.given = min(time, self.end)
        return found

    def _hole(self) -> float:
        """Until when nothing moves, if that is beyond what was given: a hole need not be caught up
        with.
        """
        times = [knot[0] for knot in self._knots]
        later = next((i for i, due in enumerate(times) if due > self.given), 0)
        if later and times[later] - times[later - 1] > _LONGEST:
            return times[later]
        return -math.inf

    def at(self, time: float) -> Setpoint | None:
        """What the arm is to be given at ``time`` (monotonic s); None before the first setpoint.
        After the last one it holds.
        """
        knots = self._knots
        while len(knots) > 2 and knots[2][0] <= time:
            knots.popleft()  # one before the present interval is kept, for its slope
        if not knots or time < knots[0][0]:
            return None
        i = max(k for k in range(min(len(knots), 2)) if knots[k][0] <= time)
        begin, pose, setpoint = knots[i]
        if i + 1 == len(knots) or knots[i + 1][0] - begin > _LONGEST:
            return Setpoint(setpoint.sequence, setpoint.written, setpoint.due, pose)
        end, after, _ = knots[i + 1]
        before = knots[i - 1] if i > 0 and begin - knots[i - 1][0] < _LONGEST else None
        beyond = knots[i + 2] if i + 2 < len(knots) and knots[i + 2][0] - end < _LONGEST else None
        span = end - begin
        u = (time - begin) / span
        mixed = []
        for c in range(6):
            a, b = pose[c], after[c]
            rise = b - a
            slope_a = rise if before is None else span * (b - before[1][c]) / (end - before[0])
            slope_b = rise if beyond is None else span * (beyond[1][c] - a) / (beyond[0] - begin)
            mixed.append(
                a
                + u
                * (
                    slope_a
                    + u * (3 * rise - 2 * slope_a - slope_b + u * (slope_a + slope_b - 2 * rise))
                )
            )
        return Setpoint(setpoint.sequence, setpoint.written, setpoint.due, mixed)


def _nearest(rotation: Sequence[float], reference: Sequence[float]) -> Sequence[float]:
    """The rotation vector of the same rotation that is nearest to ``reference``: a tool that points
    down is half a turn away from the base, where the vector flips its sign."""
    angle = math.hypot(*rotation)
    if angle < 1e-9 or math.dist(rotation, reference) < math.pi:  # the others are further away
        return rotation
    turns = [[c * (1.0 + 2.0 * math.pi * k / angle) for c in rotation] for k in (-1, 0, 1)]
    return min(turns, key=lambda r: math.dist(r, reference))
