"""The next strikes of the running real cell as a :class:`Recording`."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Any

from pianobot_msgs.msg import MidiEvent, StrikeMark, VacuumState, WristCommand, WristState
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from scipy.spatial.transform import Rotation

from pianobot_ros.cell.geometry import FINGERS
from pianobot_ros.cell.keystroke import NoteEvent
from pianobot_ros.cell.recording import Recording, Strike
from pianobot_ros.cell_gap.live import Collector
from pianobot_ros.nodes import common

__all__ = ["LiveRecording"]

DEPTH = 2000  # messages that may wait while the executor is busy
LATE = 0.3  # s after a strike's window in which its last samples still arrive


class LiveRecording:
    """Listens to commands and to the real cell from construction until :meth:`close`."""

    def __init__(self, node: Node, memory: float = 600.0) -> None:
        self._node, self._collector, self._begun = node, Collector(memory), time.time()
        best = QoSProfile(depth=DEPTH, history=HistoryPolicy.KEEP_LAST, reliability=ReliabilityPolicy.BEST_EFFORT)
        sure = QoSProfile(depth=DEPTH, history=HistoryPolicy.KEEP_LAST, reliability=ReliabilityPolicy.RELIABLE)
        wanted: list[tuple[Any, str, Any, QoSProfile]] = [
            (WristCommand, "/command/wrist", lambda m: self._wrist("command/wrist", m), sure),
            (WristState, "/real/wrist/state", lambda m: self._wrist("real/wrist/state", m), best),
            (VacuumState, "/real/vacuum/state", self._vacuum, best),
            (MidiEvent, "/real/midi", self._midi, common.EVENT_QOS),
            (StrikeMark, "/command/strike", self._strike, common.EVENT_QOS),
        ]
        self._subscriptions = [node.create_subscription(*entry) for entry in wanted]

    @property
    def strikes(self) -> int:
        """Strikes that were announced since the start and are over."""
        return len(self._finished())

    def recording(self) -> Recording:
        """What was played so far."""
        return self._collector.recording(self._finished())

    def close(self) -> None:
        """Stop listening."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._subscriptions = []

    def _finished(self) -> list[Strike]:
        # A strike that had begun before is only half recorded.
        return [s for s in list(self._collector.strikes) if s.start > self._begun and s.end < time.time() - LATE]

    def _wrist(self, name: str, message: WristCommand | WristState) -> None:
        stamp = common.seconds(message.header.stamp)
        p, q = message.pose.position, message.pose.orientation
        self._collector.add(f"{name}.position", stamp, (p.x, p.y, p.z))
        length = math.sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w)
        rotation = Rotation.from_quat((q.x, q.y, q.z, q.w)).as_rotvec() if length > 1e-6 else (0.0, 0.0, 0.0)
        self._collector.add(f"{name}.rotation", stamp, tuple(rotation))

    def _vacuum(self, message: VacuumState) -> None:
        stamp = common.seconds(message.header.stamp)
        self._collector.add("real/vacuum/state.setpoint", stamp, _by_finger(message.fingers, message.setpoint))
        self._collector.add("real/vacuum/state.measured", stamp, _by_finger(message.fingers, message.measured))

    def _midi(self, message: MidiEvent) -> None:
        kind = message.status & 0xF0
        if kind in (MidiEvent.NOTE_ON, MidiEvent.NOTE_OFF):
            stamp = common.seconds(message.header.stamp)
            self._collector.note(NoteEvent(stamp, kind == MidiEvent.NOTE_ON, int(message.note), int(message.velocity)))

    def _strike(self, m: StrikeMark) -> None:
        start, end = common.seconds(m.header.stamp), common.seconds(m.end)
        self._collector.strike(
            Strike(
                int(m.index), m.phrase, m.condition, m.finger, int(m.note), start, end, m.speed, m.depth, m.hold, m.pressure,
                m.note_length,
            )
        )  # fmt: skip


def _by_finger(fingers: Sequence[str], values: Sequence[float]) -> tuple[float, ...]:
    named = dict(zip(fingers, values, strict=False))
    return tuple(float(named.get(f, math.nan)) for f in FINGERS)
