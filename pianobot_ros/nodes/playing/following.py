"""Whether an arm moves with the setpoints: a stream that does not arrive looks, to its sender, like
one that does.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Sequence

__all__ = ["Following"]

MOVED = 0.01  # m that the setpoints must have moved before they say anything
SHARE = (
    0.2  # of the setpoints' travel that an arm's own target has at least, however much it clamps
)


class Following:
    """What was sent to a cell, and the setpoint that it said it was following, over the last
    ``window`` s.
    """

    def __init__(self, window: float) -> None:
        self._window = window
        self._seen: deque[tuple[float, Sequence[float], Sequence[float]]] = deque()

    def look(self, t: float, sent: Sequence[float], target: Sequence[float]) -> None:
        """Positions (3,) m that were sent and reported last, at time ``t`` s."""
        self._seen.append((t, sent, target))
        while self._seen[0][0] < t - self._window:
            self._seen.popleft()

    @property
    def deaf(self) -> bool:
        """True if the setpoints moved and the arm's own target did not."""
        if not self._seen:
            return False
        _, sent, target = zip(*self._seen, strict=True)
        travel = _travel(sent)
        return travel > MOVED and _travel(target) < SHARE * travel


def _travel(places: Iterable[Sequence[float]]) -> float:
    """Diagonal of the box around them, m."""
    return math.hypot(*(max(axis) - min(axis) for axis in zip(*places, strict=True)))
