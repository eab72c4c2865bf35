"""The optimizer node: feedback, cancel, resume, the same result for the same seed, and the strikes
of a running cell.
"""

from __future__ import annotations

import itertools
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from pianobot_msgs.action import IdentifyKeystroke, OptimizeStiffness
from pianobot_msgs.msg import MidiEvent, StrikeMark, WristState
from rclpy.action import ActionClient
from rclpy.parameter import Parameter
from scipy.spatial.transform import Rotation

from pianobot_ros.bags.message_types import Schema
from pianobot_ros.bags.raw_messages import RawMessage
from pianobot_ros.bags.write import write_bag
from pianobot_ros.cell.recordings.recording import Recording
from pianobot_ros.emulator.plant.offline import simulate_cell, standard_strikes
from pianobot_ros.nodes.analysis.optimizer import OptimizerNode
from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.session.marks import mark_message
from pianobot_ros.testing import wait_for

pytestmark = [pytest.mark.graph, pytest.mark.slow]


@pytest.fixture(scope="module")
def played() -> Recording:
    return simulate_cell(
        standard_strikes(3, 4, repeats=4), parameter_errors={"joint_stiffness": 0.2}, encoder=True
    )


@pytest.fixture(scope="module")
def bag(played: Recording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(played, tmp_path_factory.mktemp("bags") / "strikes")


class Stage:
    """The node and a client of its actions."""

    def __init__(self, ros: Any, folder: Path, **parameters: Any) -> None:
        self.ros = ros
        self.tester = ros.node("tester")
        values = {"state_directory": str(folder), **parameters}
        self.node = ros.add(
            OptimizerNode(
                context=ros.context,
                parameter_overrides=[Parameter(n, value=v) for n, v in values.items()],
            )
        )
        self.feedback: list[Any] = []
        self.optimize = ActionClient(self.tester, OptimizeStiffness, "/optimize_stiffness")
        self.identify = ActionClient(self.tester, IdentifyKeystroke, "/identify_keystroke")
        ros.wait_for(
            lambda: self.optimize.server_is_ready() and self.identify.server_is_ready(),
            "the servers",
        )

    def send(self, client: Any, goal: Any) -> Any:
        future = client.send_goal_async(goal, lambda m: self.feedback.append(m.feedback))
        return self.ros.wait_for(future, "the goal's acceptance")

    def result(self, handle: Any) -> Any:
        return self.ros.wait_for(handle.get_result_async(), "the result", 600)

    def heard_feedback(self, count: int) -> None:
        """Wait for feedback that an answer has overtaken."""
        self.ros.wait_for(lambda: len(self.feedback) >= count, f"{count} times feedback")

    def run(self, **request: Any) -> Any:
        goal = OptimizeStiffness.Goal(lambda1=0.8, lambda2=0.2, **request)
        return self.result(self.send(self.optimize, goal))


@pytest.mark.long
def test_feedback_and_the_same_result_for_the_same_seed(
    ros: Any, bag: Path, tmp_path: Path
) -> None:
    stage = Stage(ros, tmp_path)
    first = stage.run(reference=str(bag), iterations=9, seed=5)
    assert first.status == GoalStatus.STATUS_SUCCEEDED and first.result.success
    stage.heard_feedback(9)
    assert [f.iteration for f in stage.feedback] == list(range(1, 10))
    assert min(f.objective_value for f in stage.feedback) == first.result.objective_value
    assert first.result.low <= first.result.high and 0 < first.result.err < 0.2
    tried = [f.objective_value for f in stage.feedback]
    second = stage.run(reference=str(bag), iterations=9, seed=5)
    stage.heard_feedback(18)
    again = [f.objective_value for f in stage.feedback][-9:]
    other = stage.run(reference=str(bag), iterations=9, seed=6)
    stage.heard_feedback(27)
    # The seed is the search's; the estimate with everything unknown has none.
    assert second.result.stiffness == first.result.stiffness == other.result.stiffness
    assert again == tried and [f.objective_value for f in stage.feedback][-9:] != tried


@pytest.mark.long
def test_a_cancelled_search_resumes_to_the_result_of_an_uninterrupted_one(
    ros: Any, bag: Path, tmp_path: Path
) -> None:
    stage = Stage(ros, tmp_path)
    request = {"reference": str(bag), "iterations": 14, "seed": 2}
    whole = json.loads(stage.run(**request).result.json)
    stage.feedback.clear()
    handle = stage.send(
        stage.optimize,
        OptimizeStiffness.Goal(lambda1=0.8, lambda2=0.2, **{**request, "iterations": 200}),
    )
    assert not stage.send(stage.optimize, OptimizeStiffness.Goal(reference=str(bag))).accepted, (
        "one job at a time"
    )
    ros.wait_for(lambda: len(stage.feedback) >= 7, "seven iterations")
    ros.wait_for(handle.cancel_goal_async())
    answer = stage.result(handle)
    assert answer.status == GoalStatus.STATUS_CANCELED and "state in" in answer.result.message
    state = json.loads(answer.result.json)["state_file"]
    done = json.loads(answer.result.json)["history"]
    assert 7 <= len(done) < 200
    longer = json.loads(
        stage.run(**{**request, "iterations": len(done) + 3}, resume=state).result.json
    )
    assert longer["history"][: len(done)] == done
    both = min(len(longer["history"]), len(whole["history"]))
    assert longer["history"][:both] == whole["history"][:both], (
        "as if it had never been interrupted"
    )


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        ({"reference": ""}, "no reference"),
        ({"reference": "/nowhere/bag"}, "does not exist"),
        ({"reference": "x.yaml"}, "standard MIDI file"),
        ({"reference": "live", "objective": "papr"}, "did you mean 'paper'"),
        ({"reference": "live", "resume": "/nowhere/state.json"}, "no state file"),
    ],
)
def test_what_cannot_be_done_is_said_in_words(
    ros: Any, tmp_path: Path, request_: dict[str, str], words: str
) -> None:
    stage = Stage(ros, tmp_path)
    answer = stage.run(**request_)
    assert answer.status == GoalStatus.STATUS_ABORTED and not answer.result.success
    assert words in answer.result.message and "\n" not in answer.result.message


def test_weights_must_sum_to_one(ros: Any, bag: Path, tmp_path: Path) -> None:
    stage = Stage(ros, tmp_path)
    handle = stage.send(
        stage.optimize, OptimizeStiffness.Goal(reference=str(bag), lambda1=0.8, lambda2=0.8)
    )
    assert "sum to 1" in stage.result(handle).result.message


def test_the_keystroke_is_identified_with_progress(ros: Any, bag: Path, tmp_path: Path) -> None:
    stage = Stage(ros, tmp_path)
    answer = stage.result(
        stage.send(stage.identify, IdentifyKeystroke.Goal(recording=str(bag), seed=1))
    )
    assert answer.status == GoalStatus.STATUS_SUCCEEDED
    ros.wait_for(lambda: stage.feedback and stage.feedback[-1].progress == 1.0, "its end")
    shares = [f.progress for f in stage.feedback]
    assert shares == sorted(shares)
    found = dict(zip(answer.result.names, answer.result.values, strict=True))
    assert found["stiffness"] == pytest.approx(3.4, rel=0.03)


@pytest.fixture
def endless(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bags that never end."""
    other = RawMessage("/other", "std_msgs/msg/String", 1, 1, b"", Schema("", "ros2msg", ""), "")
    monkeypatch.setattr(
        "pianobot_ros.bags.reading.read.read_raw", lambda *_: itertools.repeat(other)
    )


@pytest.mark.parametrize("action", ["optimize", "identify"])
def test_a_cancel_ends_the_reading_of_a_bag(
    ros: Any, endless: None, tmp_path: Path, action: str
) -> None:
    stage = Stage(ros, tmp_path)
    goal = {
        "optimize": OptimizeStiffness.Goal(reference=str(tmp_path), lambda1=0.5, lambda2=0.5),
        "identify": IdentifyKeystroke.Goal(recording=str(tmp_path)),
    }[action]
    for _ in range(2):  # and the next goal is accepted
        handle = stage.send(getattr(stage, action), goal)
        assert handle.accepted
        ros.wait_for(handle.cancel_goal_async(), "the cancel's answer")
        answer = stage.result(handle)
        assert answer.status == GoalStatus.STATUS_CANCELED and not answer.result.success
        assert answer.result.message == f"cancelled while {tmp_path} was read"


def test_the_end_of_the_node_ends_the_reading_of_a_bag(
    ros: Any, endless: None, tmp_path: Path
) -> None:
    stage = Stage(ros, tmp_path)
    stage.send(stage.identify, IdentifyKeystroke.Goal(recording=str(tmp_path)))
    ros.wait_for(lambda: stage.feedback, "the beginning")
    stage.node.shut_down()
    # Its thread has a low priority: a busy machine may let it wait for longer than the node does.
    wait_for(lambda: not stage.node._job.busy, "the end of the reading")


def test_strikes_of_the_running_cell_are_collected(
    ros: Any, played: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The messages of a played recording, each sent at its stamp."""
    # s in which the last samples still arrive, where the sender may be held up
    monkeypatch.setattr("pianobot_ros.nodes.analysis.live_recording.LATE", 5.0)
    stage = Stage(ros, tmp_path, live_strikes=2)
    handle = stage.send(stage.optimize, OptimizeStiffness.Goal(reference="live", iterations=7))
    wrist = stage.tester.create_publisher(WristState, "/real/wrist/state", common.SENSOR_QOS)
    midi = stage.tester.create_publisher(MidiEvent, "/real/midi", common.EVENT_QOS)
    marks = stage.tester.create_publisher(StrikeMark, "/command/strike", common.EVENT_QOS)
    ros.wait_for(
        lambda: all(p.get_subscription_count() for p in (wrist, midi, marks)), "subscribers"
    )
    strikes = played.strikes[:2]
    epoch = time.time() + 0.02 - strikes[0].start
    end = strikes[-1].end + 0.2
    position, rotation = (played.signals[f"real/wrist/state.{n}"] for n in ("position", "rotation"))

    def stamp(t: float) -> Any:
        return common.time_msg(round(1e9 * (epoch + t)))

    for s in strikes:
        marks.publish(mark_message(s, round(1e9 * epoch)))
    messages: list[tuple[float, Any, Any]] = []
    for t, p, r in zip(position.time, position.value, rotation.value, strict=True):
        state = WristState()
        at, turn = state.pose.position, state.pose.orientation
        at.x, at.y, at.z = map(float, p)
        turn.x, turn.y, turn.z, turn.w = map(float, Rotation.from_rotvec(r).as_quat())
        messages.append((float(t), wrist, state))
    for n in played.notes["real"]:
        status = MidiEvent.NOTE_ON if n.on else MidiEvent.NOTE_OFF
        event = MidiEvent(status=status, note=n.note, velocity=n.velocity)
        messages.append((n.time, midi, event))
    for t, publisher, message in sorted(messages, key=lambda m: m[0]):
        if t > end:
            break
        # At its time: what came before its stamp would tell of a clock that is ahead.
        ros.wait_for(lambda due=epoch + t: time.time() >= due, "its time")
        message.header.stamp = stamp(t)
        publisher.publish(message)
    answer = stage.result(handle)
    assert answer.result.success, answer.result.message
    assert len(json.loads(answer.result.json)["keystrokes"]) == 2
    assert np.isfinite(answer.result.err)


def test_no_strikes_is_said_with_the_number_that_came(ros: Any, tmp_path: Path) -> None:
    stage = Stage(ros, tmp_path, live_timeout=1.0)
    answer = stage.run(reference="live")
    assert "0 of 4 strikes" in answer.result.message
