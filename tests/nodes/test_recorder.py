"""The recorder against hand-made publishers: whole bags, killed ones, and a disk without room."""

from __future__ import annotations

import shutil
import signal
import time
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from pianobot_msgs.msg import KeyForce, StrikeMark
from rclpy.duration import Duration
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from std_srvs.srv import Trigger

from pianobot_ros.bags.info import bag_info
from pianobot_ros.bags.raw_messages import read_raw
from pianobot_ros.bags.repair import is_whole, repair_bag
from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.watching import recorder
from pianobot_ros.testing import TIMEOUT

pytestmark = pytest.mark.graph

NODE = "pianobot_ros.nodes.watching.recorder"


class Stage:
    """The recorder as a process, and a fast and a reliable topic for it."""

    def __init__(self, ros: Any, processes: Any, bag: Path, *parameters: str) -> None:
        self.ros, self.bag = ros, bag
        self.tester = ros.node("tester")
        self.force = self.tester.create_publisher(KeyForce, "/real/fsr", common.SENSOR_QOS)
        # Deep: a recorder that is held up gets later what it has not taken meanwhile.
        self.marks = ros.publisher(StrikeMark, "/command/strike")
        words = [w for p in (f"output:={bag}", *parameters) for w in ("-p", p)]
        self.process = processes.python(NODE, "--ros-args", *words, log="recorder")
        self.count = 0

    def matched(self) -> None:
        self.ros.wait_for(
            lambda: self.force.get_subscription_count() and self.marks.get_subscription_count(),
            "the recorder listens",
        )

    def publish(self, seconds: float) -> None:
        """Publish at 200 Hz, and wait until the recorder has what it is to have."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            now = common.time_msg(time.time_ns())
            force = KeyForce(note=64, force=1.0, sequence=self.count)
            force.header.stamp = now
            self.force.publish(force)
            mark = StrikeMark(index=self.count)
            mark.header.stamp = now
            self.marks.publish(mark)
            self.count += 1
            self.ros.executor.spin_once(timeout_sec=0.005)
        # A message that is still on the way when the recorder ends is none that it lost.
        assert self.marks.wait_for_all_acked(Duration(seconds=TIMEOUT)), "not acknowledged"

    def kept(self) -> list[int]:
        """Numbers of the marks that are on the disk."""
        return [
            deserialize_message(raw.data, StrikeMark).index
            for raw in read_raw(self.bag)
            if raw.topic == "/command/strike"
        ]


@pytest.fixture
def stage(ros: Any, processes: Any, tmp_path: Path) -> Stage:
    """With a second of messages published."""
    made = Stage(ros, processes, tmp_path / "bag")
    made.matched()
    made.publish(1.0)
    return made


def test_a_bag_that_every_reader_opens_and_no_reliable_message_is_lost(stage: Stage) -> None:
    assert stage.process.end() == 0
    with Reader(stage.bag) as reader:
        counts = {c.topic: c.msgcount for c in reader.connections}
    assert counts["/command/strike"] == stage.count
    (file,) = stage.bag.glob("*.mcap")
    with file.open("rb") as stream:
        assert (
            sum(1 for _ in make_reader(stream).iter_messages(topics=["/command/strike"]))
            == stage.count
        )
    assert is_whole(stage.bag)
    readable_by_others(stage)


def readable_by_others(stage: Stage) -> None:
    """By the standard readers, which check the types' hashes, with QoS and in the order of time."""
    with AnyReader([stage.bag]) as reader:
        assert {c.msgtype for c in reader.connections} >= {
            "diagnostic_msgs/msg/DiagnosticArray",
            "pianobot_msgs/msg/StrikeMark",
        }
        marks = [c for c in reader.connections if c.topic == "/command/strike"]
        indices = [
            reader.deserialize(data, c.msgtype).index for c, _, data in reader.messages(marks)
        ]
        assert indices == list(range(stage.count))
        (qos,) = marks[0].ext.offered_qos_profiles
        assert qos.reliability.name == "RELIABLE"
    (file,) = stage.bag.glob("*.mcap")
    with file.open("rb") as stream:
        decoded = list(
            make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages(
                log_time_order=False
            )
        )
    times = [message.log_time for _, _, message, _ in decoded]
    assert times == sorted(times)
    assert all(message.publish_time <= message.log_time for _, _, message, _ in decoded)
    assert {m.note for _, channel, _, m in decoded if channel.topic == "/real/fsr"} == {64}


def test_a_killed_bag_loses_little_and_is_repaired(ros: Any, stage: Stage) -> None:
    # While it runs, what has arrived goes to the disk; what has not when it is killed is lost.
    ros.wait_for(lambda: len(stage.kept()) == stage.count, "all of it on the disk")
    before = stage.count
    stage.publish(0.3)
    stage.process.send_signal(signal.SIGKILL)
    stage.process.wait(TIMEOUT)
    assert before <= len(stage.kept()) <= stage.count
    assert stage.kept() == list(range(len(stage.kept())))
    assert not is_whole(stage.bag)
    repaired = repair_bag(stage.bag)
    assert repaired.original is not None and repaired.original.is_dir(), "the original is kept"
    assert is_whole(stage.bag) and repaired.messages == bag_info(stage.bag).messages
    assert repair_bag(stage.bag).original is None, "a whole bag is left alone"


def test_a_full_disk_is_said_and_leaves_a_whole_bag(
    ros: Any, processes: Any, tmp_path: Path
) -> None:
    diagnostics = ros.record(DiagnosticArray, "/diagnostics")
    stage = Stage(ros, processes, tmp_path / "bag", "min_free:=1.0e9")
    ros.wait_for(
        lambda: any(
            "make room" in s.message and s.level == b"\x02" for d in diagnostics for s in d.status
        ),
        "the error",
    )
    stage.process.end()
    assert processes.output("recorder").count("ERROR") == 1
    assert (stage.bag / "metadata.yaml").is_file()


def test_a_bag_that_is_taken_away_is_said(stage: Stage, processes: Any) -> None:
    shutil.rmtree(stage.bag)
    stage.ros.wait_for(lambda: "recording ended" in processes.output("recorder"), "word of it")
    assert stage.process.end() == 0
    assert "Traceback" not in processes.output("recorder")


def test_bags_begin_and_end_by_service(ros: Any, processes: Any, tmp_path: Path) -> None:
    stage = Stage(ros, processes, tmp_path / "bag", "autostart:=false")
    clients = {
        name: stage.tester.create_client(Trigger, f"/recorder/{name}") for name in ("start", "stop")
    }
    ros.wait_for(lambda: all(c.service_is_ready() for c in clients.values()), "the services")

    def call(name: str) -> Any:
        return ros.wait_for(clients[name].call_async(Trigger.Request()))

    assert not call("stop").success
    for expected in ("bag", "bag-2"):
        started = call("start")
        assert started.success and Path(started.message).name == expected
        assert not call("start").success
        stage.matched()
        stage.publish(0.3)
        assert call("stop").success
        assert is_whole(tmp_path / expected)


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_the_command_closes_its_bag_at_any_signal(
    ros: Any, processes: Any, tmp_path: Path, end: signal.Signals
) -> None:
    """Also at one that reaches its process alone, as another program sends it."""
    bag = tmp_path / "bag"
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # it is inherited: from nohup, say
    process = processes.python("pianobot_ros.cli.app", "record", str(bag), log="record")
    signal.signal(signal.SIGHUP, before)
    marks = ros.publisher(StrikeMark, "/command/strike")
    ros.wait_for(marks.get_subscription_count, "the recorder listens")
    marks.publish(StrikeMark(index=1))
    file = bag / "bag_0.mcap"
    processes.wait_for(lambda: b"/command/strike" in file.read_bytes(), "it is on the disk")
    process.send_signal(end)
    assert process.wait(TIMEOUT) == 0
    counts = {t.name: t.count for t in bag_info(bag).topics}
    assert is_whole(bag) and counts["/command/strike"] == 1


def test_a_recorder_that_is_interrupted_while_it_is_made_closes_its_bag(
    ros: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its thread records from the moment that it starts, also before the node is there."""

    def interrupted(beat: recorder.Beat) -> None:
        raise KeyboardInterrupt

    bag = tmp_path / "bag"
    monkeypatch.setattr(recorder.Beat, "start", interrupted)
    options = {"parameter_overrides": [Parameter("output", value=str(bag))]}
    with pytest.raises(KeyboardInterrupt):
        recorder.Recorder(context=ros.context, **options)
    assert is_whole(bag)
