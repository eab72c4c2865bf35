"""The streams of the running real cell and the commands, collected as they come and decoded a batch at a time."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from pianobot_msgs.msg import (
    KeyAngle,
    KeyForce,
    MidiEvent,
    StrikeMark,
    VacuumCommand,
    VacuumState,
    WristCommand,
    WristState,
)
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from scipy.spatial.transform import Rotation

from pianobot_ros.cell.geometry import FINGERS
from pianobot_ros.cell.keystroke import NoteEvent
from pianobot_ros.cell.recording import Strike
from pianobot_ros.cell_gap.live import Collector
from pianobot_ros.nodes import common
from pianobot_ros.nodes.polled import PolledSubscription, stream_qos
from pianobot_ros.nodes.wire import angle_place, force_place, table, vacuum_place, wrist_place

__all__ = ["LiveSignals"]

PERIOD = 0.5  # s between two decodings
DEPTH = 2000  # messages of one topic that may come meanwhile, with a wide margin


class LiveSignals:
    """Feeds a :class:`Collector` from construction until :meth:`close`. ``lock`` guards the collector.

    Args:
        node: whose executor turns this.
        collector: where everything goes.
        key: also the key's force and angle.
    """

    def __init__(self, node: Node, collector: Collector, *, key: bool = True) -> None:
        self._node, self.collector, self.lock = node, collector, threading.Lock()
        kinds: dict[str, tuple[Any, bool]] = {
            "command/wrist": (WristCommand, True), "real/wrist/state": (WristState, False),
            "command/vacuum": (VacuumCommand, True), "real/vacuum/state": (VacuumState, False),
        }  # fmt: skip
        if key:
            kinds |= {"real/fsr": (KeyForce, False), "real/key_angle": (KeyAngle, False)}
        self._streams = {
            name: PolledSubscription(node, kind, f"/{name}", stream_qos(DEPTH, sure))
            for name, (kind, sure) in kinds.items()
        }
        self._decoders: dict[str, Callable[[str, Sequence[bytes]], None]] = {
            "command/wrist": self._wrist, "real/wrist/state": self._wrist, "command/vacuum": self._vacuum,
            "real/vacuum/state": self._vacuum, "real/fsr": self._force, "real/key_angle": self._angle,
        }  # fmt: skip
        self._subscriptions = [
            node.create_subscription(MidiEvent, "/real/midi", self.midi, common.EVENT_QOS),
            node.create_subscription(StrikeMark, "/command/strike", self.strike, common.EVENT_QOS),
        ]
        self._timer = node.create_timer(PERIOD, self.poll)

    def poll(self) -> None:
        """Take in what has arrived."""
        for name, stream in self._streams.items():
            if taken := stream.take():
                self.feed(name, [data for data, _ in taken])

    def feed(self, name: str, messages: Sequence[bytes]) -> None:
        """Serialized messages of one topic, its name without the leading slash."""
        with self.lock:
            self._decoders[name](name, messages)

    def close(self) -> None:
        """Stop listening."""
        self._node.destroy_timer(self._timer)
        for stream in self._streams.values():
            stream.destroy()
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._streams, self._subscriptions = {}, []

    # One topic each.

    def _wrist(self, name: str, messages: Sequence[bytes]) -> None:
        times, values = table(messages, [wrist_place(axis) for axis in range(7)])
        unit = np.abs(np.linalg.norm(values[:, 3:], axis=1) - 1.0) < 0.1
        values[~unit, 3:] = (0.0, 0.0, 0.0, 1.0)
        self.collector.add(f"{name}.position", times, values[:, :3])
        self.collector.add(f"{name}.rotation", times, Rotation.from_quat(values[:, 3:]).as_rotvec())

    def _vacuum(self, name: str, messages: Sequence[bytes]) -> None:
        fields = ("pressure",) if name.startswith("command") else ("setpoint", "measured")
        for array, field in enumerate(fields):
            self.collector.add(f"{name}.{field}", *table(messages, [vacuum_place(f, array) for f in FINGERS]))

    def _force(self, name: str, messages: Sequence[bytes]) -> None:
        self.collector.fsr_note = int(deserialize_message(messages[-1], KeyForce).note)
        times, values = table(messages, [force_place])
        self.collector.add(f"{name}.force", times, values[:, 0])

    def _angle(self, name: str, messages: Sequence[bytes]) -> None:
        for note in map(int, deserialize_message(messages[-1], KeyAngle).notes):
            times, values = table(messages, [angle_place(note)])
            self.collector.add(f"{name}.{note}", times, values[:, 0])

    def midi(self, message: MidiEvent) -> None:
        """A note event of the real cell."""
        kind = message.status & 0xF0
        if kind in (MidiEvent.NOTE_ON, MidiEvent.NOTE_OFF):
            stamp = common.seconds(message.header.stamp)
            with self.lock:
                self.collector.note(
                    NoteEvent(stamp, kind == MidiEvent.NOTE_ON, int(message.note), int(message.velocity))
                )

    def strike(self, m: StrikeMark) -> None:
        """An announced strike."""
        start, end = common.seconds(m.header.stamp), common.seconds(m.end)
        strike = Strike(int(m.index), m.phrase, m.condition, m.finger, int(m.note), start, end, m.speed, m.depth, m.hold,
                        m.pressure, m.note_length)  # fmt: skip
        with self.lock:
            self.collector.strike(strike)
