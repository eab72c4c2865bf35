"""Recordings that were hurt, or mean harm: what can be used is used, the rest counted and said."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from pianobot_ros.bags.info import bag_info
from pianobot_ros.bags.live_writer import LiveWriter
from pianobot_ros.bags.message_types import Schema, schema_of, type_hash, typestore
from pianobot_ros.bags.raw_messages import RawMessage, read_raw
from pianobot_ros.bags.reading.read import read_bag
from pianobot_ros.bags.write import write_bag
from pianobot_ros.cell.errors import RecordingError
from pianobot_ros.cell.recordings.keystroke import NoteEvent
from pianobot_ros.cell.recordings.recording import Recording, Strike, TimeSeries

COUNT = 100
Change = Callable[[int, RawMessage], RawMessage | None]


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    time = np.arange(COUNT) * 0.01
    rng = np.random.default_rng(1)
    signals = {
        "command/wrist.position": TimeSeries(time, rng.normal(size=(COUNT, 3)), "m"),
        "real/wrist/state.position": TimeSeries(time, rng.normal(size=(COUNT, 3)), "m"),
        "real/fsr.force": TimeSeries(time, rng.random(COUNT), "N"),
        "real/key_angle.64": TimeSeries(time, 0.01 * rng.random(COUNT), "rad"),
    }
    strike = Strike(3, "p", "c1", "middle", 64, 0.1, 0.9, 0.2, 0.012, 0.3, -5e4, 2.5)
    notes = {"real": [NoteEvent(0.3, True, 64, 71), NoteEvent(0.6, False, 64, 44)]}
    recording = Recording(signals, notes, [strike], fsr_note=64, epoch=1.7e9)
    return write_bag(recording, tmp_path_factory.mktemp("hostile") / "bag")


def changed(bag: Path, target: Path, change: Change) -> Path:
    """A copy of the bag with each message changed, by its number in its topic."""
    writer, counts = LiveWriter(target), dict[str, int]()
    for raw in read_raw(bag):
        counts[raw.topic] = counts.get(raw.topic, -1) + 1
        new = change(counts[raw.topic], raw)
        if new is None:
            continue
        if not writer.knows(new.topic):
            writer.add_topic(new.topic, new.type, [], schema_of(new.type))
        writer.write(new.topic, new.log_time, new.data, new.sent)
    writer.close()
    return target


def only(topic: str, change: Change) -> Change:
    return lambda i, raw: change(i, raw) if raw.topic == topic else raw


def edited(raw: RawMessage, edit: Callable[[object], None]) -> RawMessage:
    message = typestore().deserialize_cdr(raw.data, raw.type)
    edit(message)
    return raw._replace(data=bytes(typestore().serialize_cdr(message, raw.type)))


def set_force(value: float) -> Callable[[object], None]:
    def edit(message: object) -> None:
        message.force = value  # type: ignore[attr-defined]

    return edit


@pytest.mark.parametrize(
    ("change", "left", "says"),
    [
        (lambda i, r: r._replace(data=r.data[:30]) if i % 2 else r, 50, "50 messages of /real/fsr"),
        (lambda i, r: r._replace(data=b"") if i == 7 else r, 99, "could not be decoded"),
        (lambda i, r: edited(r, set_force(np.nan)) if i == 7 else r, 99, "cannot be meant"),
        (lambda i, r: edited(r, set_force(-np.inf)) if i == 7 else r, 99, "cannot be meant"),
        (lambda i, r: edited(r, set_force(1e200)) if i == 7 else r, 99, "cannot be meant"),
    ],
)
def test_bad_messages_are_left_out_and_counted(
    bag: Path, tmp_path: Path, change: Change, left: int, says: str
) -> None:
    recording = read_bag(changed(bag, tmp_path / "bag", only("/real/fsr", change)))
    assert len(recording.signal("real/fsr.force").time) == left
    assert len(recording.signal("real/wrist/state.position").time) == COUNT
    assert len(recording.warnings) == 1 and says in recording.warnings[0]


def test_a_topic_of_another_type_is_left_out(bag: Path, tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    text = store.types["std_msgs/msg/String"]("harmless")
    data = bytes(store.serialize_cdr(text, "std_msgs/msg/String"))

    def change(i: int, raw: RawMessage) -> RawMessage:
        return raw._replace(type="std_msgs/msg/String", data=data)

    recording = read_bag(changed(bag, tmp_path / "bag", only("/real/fsr", change)))
    assert "real/fsr.force" not in recording.signals
    (warning,) = recording.warnings
    assert "100 messages of /real/fsr are of the type std_msgs/msg/String" in warning


def test_a_quaternion_that_is_none_costs_its_sample(bag: Path, tmp_path: Path) -> None:
    def crooked(message: object) -> None:
        message.pose.orientation.w = 0.0  # type: ignore[attr-defined]

    topic = "/real/wrist/state"
    target = changed(
        bag, tmp_path / "bag", only(topic, lambda i, r: edited(r, crooked) if i in (3, 5) else r)
    )
    recording = read_bag(target)
    for field in ("position", "rotation"):
        signal = recording.signal(f"real/wrist/state.{field}")
        assert len(signal.time) == COUNT - 2 and np.isfinite(signal.value).all()
    assert "2 messages of /real/wrist/state hold what cannot be meant" in recording.warnings[0]


@pytest.mark.parametrize("years", [-40, 10])
def test_a_stamp_of_another_year_costs_its_sample(bag: Path, tmp_path: Path, years: int) -> None:
    def late(message: object) -> None:
        message.header.stamp.sec += years * 31_557_600  # type: ignore[attr-defined]

    target = changed(
        bag, tmp_path / "bag", only("/real/fsr", lambda i, r: edited(r, late) if i == 50 else r)
    )
    recording = read_bag(target)
    times = recording.signal("real/fsr.force").time
    assert len(times) == COUNT - 1 and 0.0 <= times[0] < times[-1] < 1.0
    assert "1 samples of /real/fsr have a wrong stamp" in recording.warnings[0]


def test_a_topic_of_another_clock_is_left_out(bag: Path, tmp_path: Path) -> None:
    def early(message: object) -> None:
        message.header.stamp.sec -= 10**9  # type: ignore[attr-defined]

    target = changed(bag, tmp_path / "bag", only("/real/fsr", lambda i, r: edited(r, early)))
    recording = read_bag(target)
    assert "real/fsr.force" not in recording.signals
    assert max(s.time[-1] for s in recording.signals.values()) < 1.0
    assert "100 samples of /real/fsr are stamped hours away" in recording.warnings[0]


def test_changed_bytes_are_left_out_and_said(bag: Path, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    (file,) = bag.glob("*.mcap")
    original = file.read_bytes()
    read = refused = 0
    for k in range(60):
        data = bytearray(original)
        for _ in range(int(rng.integers(1, 8))):
            data[rng.integers(len(data))] ^= 1 << int(rng.integers(8))
        target = tmp_path / str(k)
        target.mkdir()
        (target / file.name).write_bytes(data)
        try:
            recording = read_bag(target)
        except RecordingError:
            refused += 1
        else:
            read += 1
            assert all(np.isfinite(s.time).all() for s in recording.signals.values())
        with np.errstate(all="raise"):
            try:
                bag_info(target)
            except RecordingError:
                continue
    assert read > 0 and read + refused == 60


def test_a_recording_without_anything_that_can_be_used_says_why(bag: Path, tmp_path: Path) -> None:
    target = changed(bag, tmp_path / "bag", lambda i, r: r._replace(data=r.data[:6]))
    with pytest.raises(RecordingError, match="could not be decoded"):
        read_bag(target)
    shutil.rmtree(target)


def test_a_message_of_no_possible_time_is_left_out_and_said(bag: Path, tmp_path: Path) -> None:
    """Found by fuzzing: nanoseconds that no signed 64 bits hold."""
    target = changed(
        bag,
        tmp_path / "bag",
        only("/real/fsr", lambda i, r: r._replace(log_time=2**63) if i == 5 else r),
    )
    info = bag_info(target)  # the writer's times never step back, so what follows is late too
    assert any("no possible time" in line for line in info.damage)
    assert 0 < {t.name: t.count for t in info.topics}["/real/fsr"] < COUNT


@pytest.mark.parametrize("field", ["note", "hold", "finger"])
def test_strikes_whose_type_lacks_a_field_are_left_out(
    bag: Path, tmp_path: Path, field: str
) -> None:
    """Another version's type, or a damaged definition."""
    kind = "pianobot_msgs/msg/StrikeMark"
    held = schema_of(kind)
    text = re.sub(rf"^(\S+ +){field}\b", rf"\1{field}ly", held.text, flags=re.MULTILINE)
    assert text != held.text
    writer = LiveWriter(tmp_path / "bag")
    for raw in read_raw(bag):
        if not writer.knows(raw.topic):
            schema = schema_of(raw.type)
            own = Schema(text, "ros2msg", "") if raw.type == kind else schema
            writer.add_topic(raw.topic, raw.type, [], own)
        writer.write(raw.topic, raw.log_time, raw.data, raw.sent)
    writer.close()
    recording = read_bag(tmp_path / "bag")
    assert recording.strikes == []
    assert any(f"lack the fields {field}" in warning for warning in recording.warnings)


def test_a_definition_with_names_that_are_none_has_no_hash() -> None:
    assert type_hash("3td/msg/A", "float64 x", "ros2msg") == ""
    text = f"3td/B b\n{'=' * 80}\nMSG: 3td/B\nfloat64 x\n"
    assert type_hash("a/msg/A", text, "ros2msg") == ""
