"""Many messages read at once say what each of them says by itself."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pianobot_ros.bags.live_writer import LiveWriter
from pianobot_ros.bags.message_types import schema_of, typestore
from pianobot_ros.bags.raw_messages import RawMessage
from pianobot_ros.bags.reading.decode import BagDecoder
from pianobot_ros.bags.reading.read import read_bag
from pianobot_ros.cell.errors import CancelledError
from pianobot_ros.cell.messages.samples import STREAMS

KINDS = sorted({stream.type for stream in STREAMS.values()})
TYPES = typestore().types


def made(kind: str, rng: np.random.Generator, size: int) -> Any:
    """A message full of random numbers; sequences of ``size``."""
    values: dict[str, Any] = {}
    for name, described in typestore().fielddefs[kind][1]:
        values[name] = _value(described, rng, size)
    return TYPES[kind](**values)


def _value(described: Any, rng: np.random.Generator, size: int) -> Any:
    node, what = described
    if node.name == "NAME":
        return made(what, rng, size)
    if node.name == "BASE":
        if what[0] == "string":
            return "x" * size
        if what[0] == "bool":
            return bool(rng.integers(2))
        return float(rng.normal()) if "float" in what[0] else int(rng.integers(100))
    inner, count = what
    count = count or size
    if inner[1][0] == "string":
        return [f"n{i}" for i in range(count)]
    return rng.integers(0, 100, count).astype(inner[1][0])


def raw_of(kind: str, message: Any, little: bool) -> RawMessage:
    data = bytes(typestore().serialize_cdr(message, kind, little_endian=little))
    return RawMessage("/real/x", kind, 1, 1, data, schema_of(kind), "")


def compare(one: Any, columns: Any, row: int) -> None:
    """Field by field, through all nested messages."""
    for name, _ in typestore().fielddefs[one.__msgtype__][1]:
        expected, found = getattr(one, name), getattr(columns, name)
        if hasattr(expected, "__msgtype__"):
            compare(expected, found, row)
        elif isinstance(found, list):
            values = [x[row] if isinstance(x, np.ndarray) else x for x in found]
            assert values == list(expected), name
        else:
            assert (found if isinstance(found, str) else found[row]) == expected, name


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("size", [0, 1, 3])
@pytest.mark.parametrize("little", [True, False])
def test_columns_are_what_each_message_says(kind: str, size: int, little: bool) -> None:
    rng = np.random.default_rng(size)
    messages = [made(kind, rng, size) for _ in range(5)]
    for message in messages[1:]:  # what names the values is the same in all
        for name in ("notes", "name", "fingers"):
            if hasattr(message, name):
                setattr(message, name, getattr(messages[0], name))
    raws = [raw_of(kind, message, little) for message in messages]
    layout = BagDecoder().layout(raws[0])
    rows = np.frombuffer(b"".join(raw.data for raw in raws), np.uint8).reshape(len(raws), -1)
    assert layout.shared_by(rows).all()
    for row, message in enumerate(messages):
        compare(message, layout.columns(rows), row)


def forces(path: Path, count: int, frame: Any) -> Path:
    """A bag with ``count`` forces 0, 1, 2, …, each in the frame ``frame(i)``."""
    kind, header, time = (
        TYPES[name]
        for name in (
            "pianobot_msgs/msg/KeyForce",
            "std_msgs/msg/Header",
            "builtin_interfaces/msg/Time",
        )
    )
    writer = LiveWriter(path)
    writer.add_topic("/real/fsr", kind.__msgtype__, [], schema_of(kind.__msgtype__))
    for i in range(count):
        stamp = time(sec=1000 + i // 1000, nanosec=i % 1000 * 1_000_000)
        message = kind(
            header=header(stamp=stamp, frame_id=frame(i)),
            note=64,
            force=float(i),
            counts=i,
            saturated=False,
            sequence=i,
        )
        data = bytes(typestore().serialize_cdr(message, kind.__msgtype__))
        writer.write("/real/fsr", stamp.sec * 10**9 + stamp.nanosec, data)
    writer.close()
    return path


@pytest.mark.parametrize(
    "frame",
    [
        lambda i: "key",
        lambda i: ("key", "k", "kez")[i % 3],
        pytest.param(lambda i: f"{i:04}", marks=pytest.mark.long),  # no two messages alike
    ],
)
def test_messages_of_several_layouts_stay_in_order(tmp_path: Path, frame: Any) -> None:
    recording = read_bag(forces(tmp_path / "bag", 5000, frame))
    force = recording.signal("real/fsr.force")
    assert np.array_equal(force.value, np.arange(5000.0))
    assert np.allclose(force.time, np.arange(5000) * 1e-3, atol=1e-6)
    assert recording.fsr_note == 64 and not recording.warnings


def test_reading_ends_when_asked(tmp_path: Path) -> None:
    bag = forces(tmp_path / "bag", 5000, lambda i: "key")
    answers = iter([False, False, True])
    with pytest.raises(CancelledError, match="cancelled while .*bag was read"):
        read_bag(bag, lambda: next(answers))
    assert not list(answers), "asked three times and no more"
