"""The optimizer node: feedback, cancel, resume, the same result for the same seed, and the strikes of a running cell."""

from __future__ import annotations

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

from pianobot_ros.bags.write import write_bag
from pianobot_ros.cell.recording import Recording
from pianobot_ros.emulator.offline import simulate_cell, standard_strikes
from pianobot_ros.nodes import common
from pianobot_ros.nodes.optimizer import OptimizerNode

pytestmark = pytest.mark.graph


@pytest.fixture(scope="module")
def played() -> Recording:
    return simulate_cell(standard_strikes(3, 4, repeats=4), parameter_errors={"joint_stiffness": 0.2}, encoder=True)


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
            OptimizerNode(context=ros.context, parameter_overrides=[Parameter(n, value=v) for n, v in values.items()])
        )
        self.feedback: list[Any] = []
        self.optimize = ActionClient(self.tester, OptimizeStiffness, "/optimize_stiffness")
        self.identify = ActionClient(self.tester, IdentifyKeystroke, "/identify_keystroke")
        ros.spin_until(lambda: self.optimize.server_is_ready() and self.identify.server_is_ready(), 30, "the servers")

    def send(self, client: Any, goal: Any) -> Any:
        future = client.send_goal_async(goal, lambda m: self.feedback.append(m.feedback))
        return self.ros.wait_for(future, 30, "the goal's acceptance")

    def result(self, handle: Any) -> Any:
        return self.ros.wait_for(handle.get_result_async(), 60, "the result")

    def run(self, **request: Any) -> Any:
        goal = OptimizeStiffness.Goal(lambda1=0.8, lambda2=0.2, **request)
        return self.result(self.send(self.optimize, goal))


def test_feedback_and_the_same_result_for_the_same_seed(ros: Any, bag: Path, tmp_path: Path) -> None:
    stage = Stage(ros, tmp_path)
    first = stage.run(reference=str(bag), iterations=9, seed=5)
    assert first.status == GoalStatus.STATUS_SUCCEEDED and first.result.success
    assert [f.iteration for f in stage.feedback] == list(range(1, 10))
    assert min(f.objective_value for f in stage.feedback) == first.result.objective_value
    assert first.result.low <= first.result.high and 0 < first.result.err < 0.2
    second = stage.run(reference=str(bag), iterations=9, seed=5)
    other = stage.run(reference=str(bag), iterations=9, seed=6)
    assert second.result.stiffness == first.result.stiffness
    assert other.result.stiffness != first.result.stiffness


def test_a_cancelled_search_resumes_to_the_result_of_an_uninterrupted_one(ros: Any, bag: Path, tmp_path: Path) -> None:
    stage = Stage(ros, tmp_path)
    request = {"reference": str(bag), "iterations": 14, "seed": 2}
    whole = json.loads(stage.run(**request).result.json)
    stage.feedback.clear()
    handle = stage.send(
        stage.optimize, OptimizeStiffness.Goal(lambda1=0.8, lambda2=0.2, **{**request, "iterations": 200})
    )
    assert not stage.send(stage.optimize, OptimizeStiffness.Goal(reference=str(bag))).accepted, "one job at a time"
    ros.spin_until(lambda: len(stage.feedback) >= 7, 40, "seven iterations")
    ros.wait_for(handle.cancel_goal_async(), 30)
    answer = stage.result(handle)
    assert answer.status == GoalStatus.STATUS_CANCELED and "state in" in answer.result.message
    state = json.loads(answer.result.json)["state_file"]
    done = json.loads(answer.result.json)["history"]
    assert 7 <= len(done) < 200
    longer = json.loads(stage.run(**{**request, "iterations": len(done) + 3}, resume=state).result.json)
    assert longer["history"][: len(done)] == done
    both = min(len(longer["history"]), len(whole["history"]))
    assert longer["history"][:both] == whole["history"][:both], "as if it had never been interrupted"


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
def test_what_cannot_be_done_is_said_in_words(ros: Any, tmp_path: Path, request_: dict[str, str], words: str) -> None:
    stage = Stage(ros, tmp_path)
    answer = stage.run(**request_)
    assert answer.status == GoalStatus.STATUS_ABORTED and not answer.result.success
    assert words in answer.result.message and "\n" not in answer.result.message


def test_weights_must_sum_to_one(ros: Any, bag: Path, tmp_path: Path) -> None:
    stage = Stage(ros, tmp_path)
    handle = stage.send(stage.optimize, OptimizeStiffness.Goal(reference=str(bag), lambda1=0.8, lambda2=0.8))
    assert "sum to 1" in stage.result(handle).result.message


def test_the_keystroke_is_identified_with_progress(ros: Any, bag: Path, tmp_path: Path) -> None:
    stage = Stage(ros, tmp_path)
    answer = stage.result(stage.send(stage.identify, IdentifyKeystroke.Goal(recording=str(bag), seed=1)))
    assert answer.status == GoalStatus.STATUS_SUCCEEDED
    shares = [f.progress for f in stage.feedback]
    assert shares == sorted(shares) and shares[-1] == 1.0
    found = dict(zip(answer.result.names, answer.result.values, strict=True))
    assert found["stiffness"] == pytest.approx(3.4, rel=0.03)


def test_strikes_of_the_running_cell_are_collected(ros: Any, played: Recording, tmp_path: Path) -> None:
    """The messages of a played recording, sent as fast as they are taken, with stamps that have just passed."""
    stage = Stage(ros, tmp_path, live_strikes=2)
    handle = stage.send(stage.optimize, OptimizeStiffness.Goal(reference="live", iterations=7))
    wrist = stage.tester.create_publisher(WristState, "/real/wrist/state", common.SENSOR_QOS)
    midi = stage.tester.create_publisher(MidiEvent, "/real/midi", common.EVENT_QOS)
    marks = stage.tester.create_publisher(StrikeMark, "/command/strike", common.EVENT_QOS)
    ros.spin_until(lambda: all(p.get_subscription_count() for p in (wrist, midi, marks)), 30, "subscribers")
    strikes = played.strikes[:2]
    epoch = time.time() + 0.02 - strikes[0].start
    end = strikes[-1].end + 0.2
    position, rotation = (played.signals[f"real/wrist/state.{n}"] for n in ("position", "rotation"))

    def stamp(t: float) -> Any:
        return common.time_msg(round(1e9 * (epoch + t)))

    for s in strikes:
        mark = StrikeMark(index=s.index, finger=s.finger, note=s.note, speed=s.speed, depth=s.depth, hold=s.hold,
                          pressure=s.pressure, note_length=s.note_length)  # fmt: skip
        mark.header.stamp, mark.end = stamp(s.start), stamp(s.end)
        marks.publish(mark)
    for t, p, r in zip(position.time, position.value, rotation.value, strict=True):
        if t > end:
            break
        state = WristState()
        state.header.stamp = stamp(t)
        state.pose.position.x, state.pose.position.y, state.pose.position.z = map(float, p)
        q = Rotation.from_rotvec(r).as_quat()
        state.pose.orientation.x, state.pose.orientation.y, state.pose.orientation.z, state.pose.orientation.w = map(
            float, q
        )
        wrist.publish(state)
        ros.executor.spin_once(timeout_sec=0.002)
    for n in played.notes["real"]:
        if n.time <= end:
            event = MidiEvent(
                status=MidiEvent.NOTE_ON if n.on else MidiEvent.NOTE_OFF, note=n.note, velocity=n.velocity
            )
            event.header.stamp = stamp(n.time)
            midi.publish(event)
    answer = stage.result(handle)
    assert answer.result.success, answer.result.message
    assert len(json.loads(answer.result.json)["keystrokes"]) == 2
    assert np.isfinite(answer.result.err)


def test_no_strikes_is_said_with_the_number_that_came(ros: Any, tmp_path: Path) -> None:
    stage = Stage(ros, tmp_path, live_timeout=1.0)
    answer = stage.run(reference="live")
    assert "0 of 4 strikes" in answer.result.message
