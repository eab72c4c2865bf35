"""Serialized messages of fast topics into samples, a batch at a time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from pianobot_msgs.msg import (
    KeyAngle,
    KeyForce,
    VacuumCommand,
    VacuumState,
    WristCommand,
    WristState,
)
from rclpy.serialization import deserialize_message

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.messages.columns import (
    angle_place,
    force_place,
    table,
    vacuum_place,
    wrist_place,
)
from pianobot_ros.cell.messages.poses import rotation_vectors
from pianobot_ros.cell.motion.geometry import FINGERS

__all__ = ["KINDS", "Decoder", "SampleSink"]


KINDS: dict[str, Any] = {
    "command/wrist": WristCommand,
    "command/vacuum": VacuumCommand,
    "wrist/state": WristState,
    "vacuum/state": VacuumState,
    "fsr": KeyForce,
    "key_angle": KeyAngle,
}
"""Message types by topic; those of a cell without ``real/`` or ``sim/``."""


class SampleSink(Protocol):
    """Where samples go: ``add`` takes a signal's name as in
    :class:`~pianobot_ros.cell.recordings.recording.Recording`, times (n,) s and values (n,) or (n,
    m).
    """

    fsr_note: int | None

    def add(self, name: str, stamps: Array, values: Array, /) -> None:
        """Take samples in."""
        ...


class Decoder:
    """Feeds a sink. ``dropped`` counts samples that were no pose."""

    def __init__(self, sink: SampleSink) -> None:
        self.sink, self.dropped = sink, 0

    def feed(self, name: str, messages: Sequence[bytes]) -> None:
        """Messages of one topic, its name without the leading slash."""
        if not messages:
            return
        topic = name.partition("/")[2] if name.startswith(("real/", "sim/")) else name
        if "wrist" in topic:
            self._wrist(name, messages)
        elif "vacuum" in topic:
            self._vacuum(name, messages)
        elif topic == "fsr":
            self._force(name, messages)
        else:
            self._angle(name, messages)

    def _wrist(self, name: str, messages: Sequence[bytes]) -> None:
        times, values = table(messages, [wrist_place(axis) for axis in range(7)])
        rotation = rotation_vectors(values[:, 3:])
        measured = np.isfinite(values[:, :3]).all(axis=1) & np.isfinite(rotation).all(axis=1)
        self.dropped += int(np.sum(~measured))
        times, values, rotation = times[measured], values[measured], rotation[measured]
        self.sink.add(f"{name}.position", times, values[:, :3])
        self.sink.add(f"{name}.rotation", times, rotation)

    def _vacuum(self, name: str, messages: Sequence[bytes]) -> None:
        fields = ("pressure",) if name.startswith("command") else ("setpoint", "measured")
        for array, field in enumerate(fields):
            places = [vacuum_place(finger, array) for finger in FINGERS]
            self.sink.add(f"{name}.{field}", *table(messages, places))

    def _force(self, name: str, messages: Sequence[bytes]) -> None:
        self.sink.fsr_note = int(deserialize_message(messages[-1], KeyForce).note)
        times, values = table(messages, [force_place])
        self.sink.add(f"{name}.force", times, values[:, 0])

    def _angle(self, name: str, messages: Sequence[bytes]) -> None:
        notes = [int(note) for note in deserialize_message(messages[-1], KeyAngle).notes]
        times, values = table(messages, [angle_place(note) for note in notes])
        for column, note in enumerate(notes):
            self.sink.add(f"{name}.{note}", times, values[:, column])
