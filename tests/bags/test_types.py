"""How a bag describes its types, against what rosidl generated."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from rosbags.highlevel import AnyReader

from pianobot_ros.bags.live_writer import LiveWriter
from pianobot_ros.bags.message_types import (
    Schema,
    _prefixes,
    definitions_dir,
    schema_of,
    typestore,
)
from pianobot_ros.bags.raw_messages import read_raw
from pianobot_ros.bags.reading.read import read_bag
from pianobot_ros.bags.repair import is_whole, repair_bag
from pianobot_ros.bags.write import _Messages
from pianobot_ros.cell.errors import RecordingError
from pianobot_ros.cell.recordings.recording import Recording

PACKAGES = ("pianobot_msgs", "diagnostic_msgs", "sensor_msgs", "geometry_msgs", "rosgraph_msgs")
FORCE = "pianobot_msgs/msg/KeyForce"


def generated(package: str) -> dict[str, str]:
    """Type and RIHS01 hash of each message of an installed package, by rosidl."""
    found = {}
    for prefix in _prefixes():
        for file in sorted((prefix / "share" / package / "msg").glob("*.json")):
            said = json.loads(file.read_text())
            kind = said["type_description_msg"]["type_description"]["type_name"]
            hashes = {h["type_name"]: h["hash_string"] for h in said["type_hashes"]}
            found[kind] = hashes[kind]
    return found


def test_every_number_of_ours_says_its_unit_or_what_it_is() -> None:
    """`ros2 interface show` has nothing else to show a stranger."""
    files = sorted(definitions_dir().parent.glob("*/*.*"))
    lines = [(f.name, line) for f in files for line in f.read_text("utf-8").splitlines()]
    floats = [(name, line) for name, line in lines if line.startswith("float")]
    assert len(floats) > 50
    assert [(name, line) for name, line in floats if "#" not in line] == []


@pytest.mark.parametrize("package", PACKAGES)
def test_a_type_has_the_hash_that_rosidl_gave_it(package: str) -> None:
    hashes = generated(package)
    assert hashes, f"{package} is installed"
    assert {kind: schema_of(kind).digest for kind in hashes} == hashes


def test_the_units_in_the_comments_are_in_the_bag() -> None:
    text = schema_of(FORCE).text
    assert "# N, by the calibration" in text and "MSG: std_msgs/Header" in text


@pytest.mark.parametrize("kind", ["nobody/msg/Nothing", "nonsense"])
def test_an_unknown_type_is_one_clear_error(kind: str) -> None:
    with pytest.raises(RecordingError, match=kind):
        schema_of(kind)


def write(folder: Path, digest: str, times: list[int]) -> Path:
    make, writer = _Messages(Recording({})), LiveWriter(folder)
    writer.add_topic("/real/fsr", FORCE, schema=Schema(schema_of(FORCE).text, "ros2msg", digest))
    for i, time in enumerate(times):
        force = make.new(
            "KeyForce",
            header=make.header(1e-9 * time),
            note=64,
            force=1.0,
            counts=1,
            saturated=False,
            sequence=i,
        )
        writer.write("/real/fsr", time, bytes(typestore().serialize_cdr(force, FORCE)))
    writer.close()
    return folder


def test_a_bag_with_the_wrong_hash_is_read_here_and_repaired_for_others(tmp_path: Path) -> None:
    """As the recorder wrote them: the digest of the definition in place of the type's hash."""
    bag = write(
        tmp_path / "bag",
        "0123456789abcdef0123456789abcdef",
        [int(1.7e18) + 1_000_000 * i for i in range(9)],
    )
    with pytest.raises(Exception, match="hash mismatch"), AnyReader([bag]):
        pass
    assert len(read_bag(bag).signals["real/fsr.force"].time) == 9
    assert not is_whole(bag)
    assert repair_bag(bag).messages == 9
    with AnyReader([bag]) as reader:
        assert reader.message_count == 9


def test_log_times_do_not_step_back_in_the_file(tmp_path: Path) -> None:
    sent = [10, 30, 20, 40]
    bag = write(tmp_path / "bag", schema_of(FORCE).digest, sent)
    found = list(read_raw(bag))
    assert [raw.log_time for raw in found] == [10, 30, 30, 40]
    assert [raw.sent for raw in found] == sent, "when it was published stays as it was"
