from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer

from pianobot_ros.bags.message_types import typestore
from pianobot_ros.bags.reading.read import read_bag
from pianobot_ros.bags.write import _Messages, write_bag
from pianobot_ros.cell.errors import RecordingError
from pianobot_ros.cell.recordings.keystroke import NoteEvent
from pianobot_ros.cell.recordings.recording import Recording, Strike, TimeSeries


@pytest.fixture
def recording() -> Recording:
    rng = np.random.default_rng(1)
    fast, slow = np.arange(0, 1, 0.002), np.arange(0, 1, 0.01)
    signals = {
        "command/wrist.position": TimeSeries(slow, rng.normal(size=(100, 3)), "m"),
        "command/wrist.rotation": TimeSeries(slow, 0.1 * rng.normal(size=(100, 3)), "rad"),
        "command/vacuum.pressure": TimeSeries(slow[:3], -1e4 * rng.random((3, 3)), "Pa"),
        "real/wrist/state.position": TimeSeries(slow, rng.normal(size=(100, 3)), "m"),
        "real/wrist/state.rotation": TimeSeries(slow, 0.1 * rng.normal(size=(100, 3)), "rad"),
        "real/wrist/state.currents": TimeSeries(slow, rng.normal(size=(100, 6)), "A"),
        "real/vacuum/state.setpoint": TimeSeries(slow, -1e4 * rng.random((100, 3)), "Pa"),
        "real/vacuum/state.measured": TimeSeries(slow, -1e4 * rng.random((100, 3)), "Pa"),
        "real/fsr.force": TimeSeries(fast, rng.random(500), "N"),
        "real/fsr.counts": TimeSeries(fast, rng.integers(0, 4096, 500).astype(float), "1"),
        "real/key_angle.64": TimeSeries(fast, 0.04 * rng.random(500), "rad"),
    }
    strike = Strike(3, "p", "c1", "middle", 64, 0.1, 0.9, 0.2, 0.012, 0.3, -5e4, 2.5)
    notes = {"real": [NoteEvent(0.3, True, 64, 71), NoteEvent(0.6, False, 64, 44)]}
    return Recording(signals, notes, [strike], fsr_note=64, epoch=1.7e9)


def test_round_trip_keeps_everything(recording: Recording, tmp_path: Path) -> None:
    back = read_bag(write_bag(recording, tmp_path / "bag"))
    for name, signal in recording.signals.items():
        # Stamps are doubles of seconds since 1970 on the way, which resolve 0.24 microseconds.
        np.testing.assert_allclose(back.signals[name].time, signal.time, atol=1e-6)
        np.testing.assert_allclose(back.signals[name].value, signal.value, atol=1e-9)
        assert back.signals[name].unit == signal.unit
    assert [(e.on, e.note, e.velocity) for e in back.notes["real"]] == [
        (True, 64, 71),
        (False, 64, 44),
    ]
    (strike,) = back.strikes
    assert (strike.condition, strike.finger, strike.note, strike.speed) == ("c1", "middle", 64, 0.2)
    assert strike.end == pytest.approx(0.9, abs=1e-6)
    assert back.fsr_note == 64
    assert back.warnings == ()


def test_other_readers_open_it(recording: Recording, tmp_path: Path) -> None:
    path = write_bag(recording, tmp_path / "bag")
    with AnyReader([path]) as reader:  # which checks each type's hash
        assert reader.message_count > 1000
        assert "/real/fsr" in reader.topics
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)


def test_a_bag_cut_short_gives_its_beginning(recording: Recording, tmp_path: Path) -> None:
    path = write_bag(recording, tmp_path / "bag")
    (file,) = path.glob("*.mcap")
    file.write_bytes(file.read_bytes()[:-3000])
    (path / "metadata.yaml").unlink()
    back = read_bag(path)
    assert len(back.signal("real/fsr.force").time) > 0


def test_a_clock_that_jumps_back_is_named(tmp_path: Path) -> None:
    make = _Messages(Recording({}))
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection(
            "/real/fsr", "pianobot_msgs/msg/KeyForce", typestore=typestore()
        )
        for i in range(500):
            stamp = 10 + 0.002 * i - (0.2 if i >= 250 else 0.0)
            message = make.new(
                "KeyForce",
                header=make.header(stamp),
                note=64,
                force=1.0,
                counts=1,
                saturated=False,
                sequence=i,
            )
            writer.write(
                connection, i * 2_000_000, typestore().serialize_cdr(message, connection.msgtype)
            )
    back = read_bag(tmp_path / "bag")
    assert "/real/fsr jumps back by 0.198 s" in back.warnings[0]
    assert np.all(np.diff(back.signal("real/fsr.force").time) > 0)


@pytest.mark.parametrize("content", [None, b"", b"not a bag at all, only text"])
def test_no_bag_is_one_clear_error(content: bytes | None, tmp_path: Path) -> None:
    path = tmp_path / "thing.mcap"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(RecordingError, match="thing.mcap"):
        read_bag(path)


def test_nothing_is_overwritten(recording: Recording, tmp_path: Path) -> None:
    write_bag(recording, tmp_path / "bag")
    with pytest.raises(RecordingError, match="exists already"):
        write_bag(recording, tmp_path / "bag")
