"""Bags that broke off: one file or several, killed at any byte, with or without a directory around
the file.
"""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader

from pianobot_ros.bags.info import bag_info
from pianobot_ros.bags.live_writer import LiveWriter
from pianobot_ros.bags.message_types import typestore
from pianobot_ros.bags.raw_messages import read_raw
from pianobot_ros.bags.reading.read import read_bag
from pianobot_ros.bags.repair import is_whole, repair_bag
from pianobot_ros.bags.write import _Messages
from pianobot_ros.cell.errors import RecordingError
from pianobot_ros.cell.recordings.recording import Recording

WRITER = """
import sys, time
from pianobot_ros.bags.live_writer import LiveWriter
from pianobot_ros.bags.message_types import typestore
from pianobot_ros.bags.write import _Messages
from pianobot_ros.cell.recordings.recording import Recording
make, writer, i = _Messages(Recording({})), LiveWriter(sys.argv[1], chunk_size=1 << 20), 0
writer.add_topic("/real/fsr", "pianobot_msgs/msg/KeyForce")
while True:
    force = make.new("KeyForce", header=make.header(1.7e9 + 0.002 * i), note=64, force=1.0,
                     counts=1, saturated=False, sequence=i)
    writer.write("/real/fsr", int(1.7e18) + 2_000_000 * i,
                 typestore().serialize_cdr(force, "pianobot_msgs/msg/KeyForce"))
    i += 1
    if i % 20 == 0:
        writer.flush()
        print(i, flush=True)
"""


def write(folder: Path, first: int = 0, count: int = 1000, name: str | None = None) -> Path:
    """A bag of one topic at 500 Hz, flushed every 20 messages; returns its file."""
    make = _Messages(Recording({}))
    writer = LiveWriter(folder, chunk_size=1 << 20)
    writer.add_topic("/real/fsr", "pianobot_msgs/msg/KeyForce")
    for i in range(first, first + count):
        header = make.header(1.7e9 + 0.002 * i)
        force = make.new(
            "KeyForce", header=header, note=64, force=1.0, counts=1, saturated=False, sequence=i
        )
        data = typestore().serialize_cdr(force, "pianobot_msgs/msg/KeyForce")
        writer.write("/real/fsr", int(1.7e18) + 2_000_000 * i, bytes(data))
        if i % 20 == 19:
            writer.flush()
    writer.close()
    return writer.file


def readable_by_everyone(bag: Path, count: int) -> None:
    with Reader(bag) as reader:
        assert reader.message_count == count == sum(1 for _ in reader.messages())
    (file,) = bag.glob("*.mcap")
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert (
        summary is not None
        and summary.statistics is not None
        and summary.statistics.message_count == count
    )
    assert len(read_bag(bag).signal("real/fsr.force").time) == count


def test_kill_9_while_writing(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    process = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(bag)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    flushed = 0
    while flushed < 2000:
        flushed = int(process.stdout.readline())
    assert bag_info(bag).recording
    with pytest.raises(RecordingError, match="is being recorded"):
        repair_bag(bag)
    assert [p.name for p in tmp_path.iterdir()] == ["bag"], "nothing was moved"
    process.send_signal(signal.SIGKILL)
    process.wait(10)
    # Lines that were still in the pipe: flushed too.
    flushed = max([flushed, *(int(line) for line in process.stdout.read().splitlines() if line)])
    process.stdout.close()
    assert not is_whole(bag) and not bag_info(bag).whole and not bag_info(bag).recording
    kept = sum(1 for _ in read_raw(bag))
    assert kept >= flushed, "what was flushed is in the file"
    done = repair_bag(bag)
    assert done.messages == kept and done.original is not None and is_whole(bag)
    readable_by_everyone(bag, kept)
    assert bag_info(bag).topics[0].gaps == ()


@pytest.mark.parametrize("share", [0.1, 0.333, 0.5, 0.77, 0.999])
def test_a_file_cut_at_any_byte_gives_its_beginning(tmp_path: Path, share: float) -> None:
    file = write(tmp_path / "bag")
    content = file.read_bytes()
    cut = content[: int(share * len(content))]
    file.write_bytes(cut)
    (tmp_path / "bag" / "metadata.yaml").unlink()
    done = repair_bag(tmp_path / "bag")
    readable_by_everyone(tmp_path / "bag", done.messages)
    assert done.messages % 20 == 0 or done.messages == 1000, "whole chunks"
    assert done.original is not None and next(done.original.glob("*.mcap")).read_bytes() == cut, (
        "untouched"
    )


def test_a_bag_in_several_files_becomes_one(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    bag.mkdir()
    for k in range(11):  # bag_10 comes after bag_9
        file = write(tmp_path / f"part{k}", first=100 * k, count=100)
        shutil.move(file, bag / f"bag_{k}.mcap")
    last = bag / "bag_10.mcap"
    last.write_bytes(last.read_bytes()[: last.stat().st_size // 2])
    done = repair_bag(bag)
    assert 1000 < done.messages < 1100 and done.duration == pytest.approx(
        0.002 * (done.messages - 1)
    )
    readable_by_everyone(bag, done.messages)
    time = read_bag(bag).signal("real/fsr.force").time
    assert np.allclose(np.diff(time), 0.002, atol=1e-6), "in order"
    assert done.original is not None and len(list(done.original.glob("*.mcap"))) == 11


def test_a_lonely_file_gets_a_bag_beside_it(tmp_path: Path) -> None:
    file = tmp_path / "found.mcap"
    shutil.move(write(tmp_path / "bag"), file)
    done = repair_bag(file)
    assert done.path == tmp_path / "found" and done.original == file and file.is_file()
    readable_by_everyone(done.path, 1000)


def test_a_whole_bag_is_left_alone_and_an_older_original_is_kept(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    file = write(bag)
    before = file.read_bytes()
    assert repair_bag(bag).original is None and repair_bag(file).original is None
    assert file.read_bytes() == before
    originals = []
    for _ in range(2):
        (bag / "metadata.yaml").unlink()
        originals.append(repair_bag(bag).original)
    assert len({*originals}) == 2 and all(o is not None and o.is_dir() for o in originals)


def test_the_rate_of_a_stream_that_comes_in_bursts_is_its_own(tmp_path: Path) -> None:
    make, writer = _Messages(Recording({})), LiveWriter(tmp_path / "bag", chunk_size=1 << 20)
    writer.add_topic("/real/fsr", "pianobot_msgs/msg/KeyForce")
    for i in range(2100):
        header = make.header(1.7e9 + 0.002 * i)
        force = make.new(
            "KeyForce", header=header, note=64, force=1.0, counts=1, saturated=False, sequence=i
        )
        data = typestore().serialize_cdr(force, "pianobot_msgs/msg/KeyForce")
        late = 2_000_000_000 if i >= 1050 else 0  # a gap is not its rate
        writer.write("/real/fsr", int(1.7e18) + 14_000_000 * (i // 7) + late, bytes(data))
    writer.close()
    (topic,) = bag_info(tmp_path / "bag").topics
    assert topic.rate == pytest.approx(500.0, rel=0.01) and len(topic.gaps) == 1


def test_a_run_of_several_bags_says_which_is_not_read(tmp_path: Path) -> None:
    run = tmp_path / "run"
    for name in ("bag", "bag-10", "bag-2"):
        write(run / name)
    write(run / "bag.damaged")
    (run / "bag-11").mkdir()
    said = f"{run} also holds bag-2, bag-10: not read"
    info = bag_info(run)
    assert info.others.startswith(said) and info.path == str(run / "bag")
    assert read_bag(run).warnings[0].startswith(said)
    assert not bag_info(run / "bag").others and not read_bag(run / "bag-2").warnings


def test_the_directory_of_a_run_stands_for_the_bag_in_it(tmp_path: Path) -> None:
    run = tmp_path / "run"
    write(run / "bag")
    assert bag_info(run).messages == bag_info(run / "bag").messages
    (run / "bag" / "metadata.yaml").unlink()
    done = repair_bag(run)
    assert done.path == run / "bag" and done.original == run / "bag.damaged"
    readable_by_everyone(done.path, 1000)


def test_nothing_to_read_changes_nothing(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    file = write(bag)
    file.write_bytes(file.read_bytes()[:60])
    (bag / "metadata.yaml").unlink()
    with pytest.raises(RecordingError, match="bag"):
        repair_bag(bag)
    assert [p.name for p in tmp_path.iterdir()] == ["bag"] and file.stat().st_size == 60
