"""The next strikes of the running real cell as a :class:`Recording`."""

from __future__ import annotations

import time

from rclpy.node import Node

from pianobot_ros.cell.recordings.recording import Recording, Strike
from pianobot_ros.nodes.analysis.live_signals import PERIOD, LiveSignals
from pianobot_ros.piano.gap.diagnosis.live import Collector

__all__ = ["LiveRecording"]

LATE = PERIOD + 0.3  # s after a strike's window in which its last samples still arrive


class LiveRecording:
    """Listens to commands and to the real cell from construction until :meth:`close`."""

    def __init__(self, node: Node, memory: float = 600.0) -> None:
        self._signals, self._begun = LiveSignals(node, Collector(memory), key=False), time.time()

    @property
    def strikes(self) -> int:
        """Strikes that were announced since the start and are over."""
        return len(self._finished())

    def recording(self) -> Recording:
        """What was played so far."""
        with self._signals.lock:
            return self._signals.collector.recording(self._finished())

    def close(self) -> None:
        """Stop listening."""
        self._signals.close()

    def _finished(self) -> list[Strike]:
        # A strike that had begun before is only half recorded.
        strikes = list(self._signals.collector.strikes)
        return [s for s in strikes if s.start > self._begun and s.end < time.time() - LATE]
