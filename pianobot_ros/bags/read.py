"""From a bag to a :class:`Recording`."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import TypesysError, get_types_from_msg
from rosbags.typesys.store import Typestore
from scipy.spatial.transform import Rotation

from pianobot_ros.bags.stream import RawMessage, read_raw
from pianobot_ros.bags.types import new_typestore
from pianobot_ros.cell.errors import RecordingError
from pianobot_ros.cell.geometry import FINGERS
from pianobot_ros.cell.keystroke import NoteEvent
from pianobot_ros.cell.recording import Recording, Signal, Strike

__all__ = ["need_topics", "read_bag"]

Array = NDArray[np.float64]
_CELL = re.compile(r"^(?:.*/)?(command|real|sim)/(.+)$")
_SMALL_STEP_BACK = (
    1e-3  # s; messages of one topic may overtake one another by less than this without being called a jump
)


def read_bag(path: str | Path) -> Recording:
    """Read a bag, whole or killed, into a :class:`Recording` on the time axis of the message stamps.

    Topics are recognised below any namespace. A topic whose clock jumps back keeps the samples before the jump and those
    after it has caught up, and ``Recording.warnings`` names it. Raises :class:`RecordingError` for a path without a bag, and
    for one in which nothing that pianobot knows was recorded.
    """
    store = new_typestore()
    rows: dict[str, list[Any]] = defaultdict(list)
    unreadable: dict[str, int] = defaultdict(int)
    seen: dict[str, str] = {}
    for raw in read_raw(path):
        match = _CELL.match(raw.topic)
        if match is None or (name := f"{match[1]}/{match[2]}") not in _READERS:
            continue
        try:
            if raw.type not in seen:
                _learn(store, raw)
                seen[raw.type] = raw.definition
            message = store.deserialize_cdr(raw.data, raw.type)
        except (TypesysError, KeyError, ValueError, IndexError, AssertionError) as error:
            unreadable[f"{raw.topic} ({type(error).__name__})"] += 1
            continue
        rows[name].append((_stamp(message, raw.log_time), message))
    if not rows:
        raise RecordingError(
            f"{path} holds no topic of a cell (/command/…, /real/… or /sim/…): was the right bag given?"
        )
    epoch = min(entries[0][0] for entries in rows.values())
    parts = _Parts(epoch)
    parts.warnings += [f"{count} messages of {topic} could not be decoded" for topic, count in unreadable.items()]
    for name, entries in rows.items():
        _READERS[name](parts, name, parts.in_order(name, entries))
    return Recording(
        signals=parts.signals,
        notes=parts.notes,
        strikes=sorted(parts.strikes, key=lambda s: s.start),
        fsr_note=parts.fsr_note,
        epoch=epoch,
        source=str(path),
        warnings=tuple(parts.warnings),
    )


def need_topics(recording: Recording, signals: Iterable[str], purpose: str) -> None:
    """Raise one :class:`RecordingError` naming every signal that ``purpose`` needs and the recording lacks."""
    missing = [f"/{name.rsplit('.', 1)[0]}" for name in signals if name not in recording.signals]
    if missing:
        topics = ", ".join(dict.fromkeys(missing))
        raise RecordingError(
            f"{recording.source}: {purpose} needs {topics}, which the bag does not hold: record it too"
        )


class _Parts:
    """What a recording is made of while it is being read."""

    def __init__(self, epoch: float) -> None:
        self.epoch = epoch
        self.signals: dict[str, Signal] = {}
        self.notes: dict[str, list[NoteEvent]] = {}
        self.strikes: list[Strike] = []
        self.fsr_note: int | None = None
        self.warnings: list[str] = []

    def in_order(self, name: str, entries: list[Any]) -> list[Any]:
        """``entries`` without those that lie before an earlier one of the same topic."""
        kept, latest, worst = [], -np.inf, 0.0
        for time, message in entries:
            if time >= latest:
                kept.append((time, message))
                latest = time
            else:
                worst = max(worst, latest - time)
        if worst > _SMALL_STEP_BACK:
            dropped = len(entries) - len(kept)
            self.warnings.append(f"the clock of /{name} jumps back by {worst:.3f} s: {dropped} samples left out")
        return kept

    def add(self, name: str, entries: list[Any], unit: str, value: Callable[[Any], Any]) -> None:
        """Add the signal ``name`` with one value for each message."""
        time = np.array([entry[0] for entry in entries]) - self.epoch
        try:
            values = np.array([value(message) for _, message in entries], dtype=float)
        except ValueError:
            self.warnings.append(f"/{name.rsplit('.', 1)[0]} has messages of different lengths: left out")
            return
        new = np.diff(time, prepend=-np.inf) > 0  # of samples with one stamp only the first can be placed in time
        self.signals[name] = Signal(time[new], values[new], unit)


def _learn(store: Typestore, raw: RawMessage) -> None:
    """Take the bag's own definition of a type that the store does not know, so that bags of other versions stay readable."""
    if raw.type not in store.fielddefs and raw.definition:
        new = get_types_from_msg(raw.definition, raw.type)
        store.register({name: fields for name, fields in new.items() if name not in store.fielddefs})


def _stamp(message: Any, log_time: int) -> float:
    header = getattr(message, "header", None)
    stamp = _seconds(header.stamp) if header is not None else 0.0
    return stamp if stamp > 0 else log_time * 1e-9


def _seconds(time: Any) -> float:
    return float(time.sec) + 1e-9 * float(time.nanosec)


def _position(pose: Any) -> list[float]:
    return [pose.position.x, pose.position.y, pose.position.z]


def _rotations(entries: list[Any], pick: Callable[[Any], Any]) -> Array:
    quaternions = np.array([[(q := pick(m).orientation).x, q.y, q.z, q.w] for _, m in entries], dtype=float)
    lengths = np.linalg.norm(quaternions, axis=1)
    quaternions[~(lengths > 0)] = [0.0, 0.0, 0.0, 1.0]  # an all-zero quaternion is how ROS spells "not set"
    return np.asarray(Rotation.from_quat(quaternions).as_rotvec())


def _read_wrist(parts: _Parts, name: str, entries: list[Any]) -> None:
    parts.add(f"{name}.position", entries, "m", lambda m: _position(m.pose))
    rotation = _rotations(entries, lambda m: m.pose)
    row = iter(rotation)
    parts.add(f"{name}.rotation", entries, "rad", lambda _: next(row))
    if name.endswith("state"):
        parts.add(f"{name}.currents", entries, "A", lambda m: m.joint_currents)
        parts.add(f"{name}.safety", entries, "1", lambda m: m.safety_state)


def _by_finger(message: Any, values: Any) -> list[float]:
    """``values`` in the order thumb, index, middle; a finger that is not named is NaN."""
    named = dict(zip(message.fingers, values, strict=False))
    return [float(named.get(finger, np.nan)) for finger in FINGERS]


def _read_vacuum_command(parts: _Parts, name: str, entries: list[Any]) -> None:
    parts.add(f"{name}.pressure", entries, "Pa", lambda m: _by_finger(m, m.pressure))


def _read_vacuum_state(parts: _Parts, name: str, entries: list[Any]) -> None:
    parts.add(f"{name}.setpoint", entries, "Pa", lambda m: _by_finger(m, m.setpoint))
    parts.add(f"{name}.measured", entries, "Pa", lambda m: _by_finger(m, m.measured))


def _read_fsr(parts: _Parts, name: str, entries: list[Any]) -> None:
    parts.add(f"{name}.force", entries, "N", lambda m: m.force)
    parts.add(f"{name}.counts", entries, "1", lambda m: m.counts)
    parts.add(f"{name}.saturated", entries, "1", lambda m: m.saturated)
    if entries and (name.startswith("real") or parts.fsr_note is None):
        parts.fsr_note = int(entries[0][1].note)


def _read_key_angle(parts: _Parts, name: str, entries: list[Any]) -> None:
    notes = sorted({int(note) for _, message in entries for note in message.notes})
    for note in notes:
        pairs = [
            (t, m.angle[int(np.flatnonzero(np.asarray(m.notes) == note)[0])]) for t, m in entries if note in m.notes
        ]
        parts.add(f"{name}.{note}", pairs, "rad", float)


def _read_joint_states(parts: _Parts, name: str, entries: list[Any]) -> None:
    parts.add(f"{name}.position", entries, "rad", lambda m: m.position)


def _read_midi(parts: _Parts, name: str, entries: list[Any]) -> None:
    parts.notes[name.split("/")[0]] = [
        NoteEvent(t - parts.epoch, (m.status & 0xF0) == 0x90, int(m.note), int(m.velocity))
        for t, m in entries
        if (m.status & 0xF0) in (0x80, 0x90)
    ]


def _read_strikes(parts: _Parts, name: str, entries: list[Any]) -> None:
    for t, m in entries:
        parts.strikes.append(
            Strike(
                index=int(m.index), phrase=m.phrase, condition=m.condition, finger=m.finger, note=int(m.note),
                start=t - parts.epoch, end=_seconds(m.end) - parts.epoch, speed=float(m.speed), depth=float(m.depth),
                hold=float(m.hold), pressure=float(m.pressure), note_length=float(m.note_length),
            )
        )  # fmt: skip


_CELL_READERS: dict[str, Callable[[_Parts, str, list[Any]], None]] = {
    "wrist/state": _read_wrist,
    "vacuum/state": _read_vacuum_state,
    "fsr": _read_fsr,
    "midi": _read_midi,
    "key_angle": _read_key_angle,
    "joint_states": _read_joint_states,
}
_READERS: dict[str, Callable[[_Parts, str, list[Any]], None]] = {
    "command/wrist": _read_wrist,
    "command/vacuum": _read_vacuum_command,
    "command/strike": _read_strikes,
    **{f"{cell}/{name}": reader for cell in ("real", "sim") for name, reader in _CELL_READERS.items()},
}
