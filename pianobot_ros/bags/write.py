"""From a :class:`Recording` to a bag that rosbag2, rosbags and mcap readers open."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from pianobot_ros.bags.live_writer import LiveWriter
from pianobot_ros.bags.message_types import typestore
from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import RecordingError
from pianobot_ros.cell.messages.events import STRIKE_FIELDS
from pianobot_ros.cell.motion.geometry import FINGERS
from pianobot_ros.cell.recordings.recording import Recording

__all__ = ["write_bag"]

Rows = Iterator[tuple[float, Any]]


def write_bag(recording: Recording, path: str | Path) -> Path:
    """Write ``recording`` as an MCAP bag directory ``path``, which must not exist yet; returns it.

    Stamps are ``recording.epoch`` plus the recording's times. Raises :class:`RecordingError` if the
    path is taken.
    """
    writer = LiveWriter(path, chunk_size=1 << 20)
    streams = []
    for topic, kind, rows in _topics(recording):
        name = f"pianobot_msgs/msg/{kind}"
        writer.add_topic(topic, name)
        streams.append(zip(rows, itertools.repeat((topic, name))))
    for (t, message), (topic, name) in heapq.merge(*streams, key=lambda row: row[0][0]):
        stamp = round((recording.epoch + t) * 1e9)
        writer.write(topic, stamp, bytes(typestore().serialize_cdr(message, name)))
    writer.close()
    return writer.path


def _topics(recording: Recording) -> Iterator[tuple[str, str, Rows]]:
    """Topic, message type and rows of everything that the recording holds."""
    make = _Messages(recording)
    have = recording.signals
    if "command/wrist.position" in have:
        yield "/command/wrist", "WristCommand", make.wrist("command/wrist")
    if "command/vacuum.pressure" in have:
        yield "/command/vacuum", "VacuumCommand", make.vacuum_command()
    if recording.strikes:
        yield "/command/strike", "StrikeMark", make.strikes()
    for cell in ("real", "sim"):
        if f"{cell}/wrist/state.position" in have:
            yield f"/{cell}/wrist/state", "WristState", make.wrist(f"{cell}/wrist/state")
        if f"{cell}/vacuum/state.measured" in have:
            yield f"/{cell}/vacuum/state", "VacuumState", make.vacuum_state(f"{cell}/vacuum/state")
        if f"{cell}/fsr.force" in have:
            yield f"/{cell}/fsr", "KeyForce", make.force(f"{cell}/fsr")
        if angles := [name for name in have if name.startswith(f"{cell}/key_angle.")]:
            yield f"/{cell}/key_angle", "KeyAngle", make.angles(angles)
        if cell in recording.notes:
            yield f"/{cell}/midi", "MidiEvent", make.midi(cell)


class _Messages:
    """Makes the rows of each topic."""

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        self.types = typestore().types

    def new(self, kind: str, **fields: Any) -> Any:
        return self.types[f"pianobot_msgs/msg/{kind}"](**fields)

    def time(self, t: float) -> Any:
        nanoseconds = round((self.recording.epoch + t) * 1e9)
        return self.types["builtin_interfaces/msg/Time"](
            sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9
        )

    def header(self, t: float, frame: str = "") -> Any:
        return self.types["std_msgs/msg/Header"](stamp=self.time(t), frame_id=frame)

    def vector(self, xyz: Any) -> Any:
        return self.types["geometry_msgs/msg/Vector3"](
            x=float(xyz[0]), y=float(xyz[1]), z=float(xyz[2])
        )

    def pose(self, position: Any, quaternion: Any) -> Any:
        point = self.types["geometry_msgs/msg/Point"](
            x=float(position[0]), y=float(position[1]), z=float(position[2])
        )
        x, y, z, w = (float(q) for q in quaternion)
        return self.types["geometry_msgs/msg/Pose"](
            position=point,
            orientation=self.types["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w),
        )

    def column(self, name: str, like: Array, fill: float) -> Array:
        """The values of a signal that may be missing, then ``fill``."""
        signal = self.recording.signals.get(name)
        return (
            signal.value
            if signal is not None and len(signal.value) == len(like)
            else np.full(np.shape(like), fill)
        )

    def wrist(self, name: str) -> Rows:
        position = self.recording.signal(f"{name}.position")
        rotation = self.column(f"{name}.rotation", position.value, 0.0)
        quaternions = Rotation.from_rotvec(rotation).as_quat()
        velocity = _rate(position.value, position.time)
        currents = self.column(f"{name}.currents", np.zeros((len(position.time), 6)), 0.0)
        zero = self.vector(np.zeros(3))
        for i, t in enumerate(position.time):
            pose = self.pose(position.value[i], quaternions[i])
            twist = self.types["geometry_msgs/msg/Twist"](
                linear=self.vector(velocity[i]), angular=zero
            )
            if name == "command/wrist":
                yield (
                    t,
                    self.new("WristCommand", header=self.header(t, "base"), pose=pose, twist=twist),
                )
            else:
                yield (
                    t,
                    self.new(
                        "WristState",
                        header=self.header(t, "base"),
                        pose=pose,
                        twist=twist,
                        target_pose=pose,
                        joint_currents=np.asarray(currents[i], dtype=np.float64),
                        controller_time=float(t),
                        speed_scaling=1.0,
                        safety_state=1,
                        program_running=True,
                    ),
                )

    def vacuum_command(self) -> Rows:
        signal = self.recording.signal("command/vacuum.pressure")
        for t, value in zip(signal.time, signal.value, strict=True):
            yield (
                t,
                self.new(
                    "VacuumCommand",
                    header=self.header(t),
                    fingers=list(FINGERS),
                    pressure=np.array(value),
                ),
            )

    def vacuum_state(self, name: str) -> Rows:
        measured = self.recording.signal(f"{name}.measured")
        setpoint = self.column(f"{name}.setpoint", measured.value, np.nan)
        for i, t in enumerate(measured.time):
            yield (
                t,
                self.new(
                    "VacuumState",
                    header=self.header(t),
                    fingers=list(FINGERS),
                    setpoint=np.array(setpoint[i]),
                    measured=np.array(measured.value[i]),
                    sequence=i,
                ),
            )

    def force(self, name: str) -> Rows:
        force = self.recording.signal(f"{name}.force")
        counts = self.column(f"{name}.counts", force.value, -1)
        saturated = self.column(f"{name}.saturated", force.value, 0)
        note = self.recording.fsr_note or 0
        for i, t in enumerate(force.time):
            yield (
                t,
                self.new(
                    "KeyForce",
                    header=self.header(t),
                    note=note,
                    force=float(force.value[i]),
                    counts=int(counts[i]),
                    saturated=bool(saturated[i]),
                    sequence=i,
                ),
            )

    def angles(self, names: list[str]) -> Rows:
        signals = [self.recording.signals[name] for name in names]
        notes = np.array([int(name.rsplit(".", 1)[1]) for name in names], dtype=np.uint8)
        if any(len(s.time) != len(signals[0].time) for s in signals):
            raise RecordingError(
                "the key angles of one cell must share their time stamps to go into one topic"
            )
        values = np.stack([s.value for s in signals], axis=1)
        velocity = _rate(values, signals[0].time)
        for i, t in enumerate(signals[0].time):
            yield (
                t,
                self.new(
                    "KeyAngle",
                    header=self.header(t),
                    notes=notes,
                    angle=values[i],
                    velocity=velocity[i],
                ),
            )

    def midi(self, cell: str) -> Rows:
        for event in sorted(self.recording.notes[cell], key=lambda e: e.time):
            yield (
                event.time,
                self.new(
                    "MidiEvent",
                    header=self.header(event.time),
                    status=144 if event.on else 128,
                    channel=0,
                    note=event.note,
                    velocity=event.velocity,
                ),
            )

    def strikes(self) -> Rows:
        for s in sorted(self.recording.strikes, key=lambda s: s.start):
            yield (
                s.start,
                self.new(
                    "StrikeMark",
                    header=self.header(s.start),
                    end=self.time(s.end),
                    **{name: getattr(s, name) for name in STRIKE_FIELDS},
                ),
            )


def _rate(value: Array, time: Array) -> Array:
    """Time derivative (n, m) of ``value``; of samples with one stamp that of the first."""
    time, first, back = np.unique(time, return_index=True, return_inverse=True)
    if time.size < 2:
        return np.zeros_like(value)
    return np.asarray(np.gradient(value[first], time, axis=0)[back])
