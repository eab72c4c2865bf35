"""How long a setpoint takes until the controller says that it follows it."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

from pianobot_ros.devices.wrist.messages import Setpoint

__all__ = ["Echo"]

SAME = 1e-7  # m between a setpoint and its echo


class Echo:
    """Remembers recent setpoints until the controller's target shows them."""

    def __init__(self) -> None:
        self._sent: deque[Setpoint] = deque(maxlen=8)

    def sent(self, setpoint: Setpoint) -> None:
        """This setpoint went to the controller."""
        self._sent.append(setpoint)

    def clear(self) -> None:
        """Wait for none of them any longer."""
        self._sent.clear()

    def latency(self, target: Sequence[float], now: float) -> float:
        """Age of the setpoint that the controller says it is following, s; NaN if it is none of
        the recent ones.
        """
        x, y, z = target[:3]
        for index in range(len(self._sent) - 1, -1, -1):
            a, b, c = self._sent[index].pose[:3]
            if abs(a - x) < SAME and abs(b - y) < SAME and abs(c - z) < SAME:
                latency = now - self._sent[index].written
                for _ in range(index + 1):
                    self._sent.popleft()
                return latency
        return math.nan
