"""The conductor between a hand-made arm (states published by the test) and recorded commands."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from pianobot_msgs.action import PlayPhrase
from pianobot_msgs.msg import StrikeMark, VacuumCommand, WristCommand, WristState
from rclpy.action import ActionClient
from rclpy.parameter import Parameter

from pianobot_ros.cell.limits import wrist_limits
from pianobot_ros.nodes import common
from pianobot_ros.nodes.conductor import Conductor

pytestmark = pytest.mark.graph

ONE = "strikes: [{note: 64, speed: 0.2, depth: 0.014, hold: 0.05}]"
LONG = "defaults: {note: 64, repeats: 40}\nstrikes: [{speed: 0.1}]"


class Stage:
    """A conductor, an arm that says where it is, and everything that is commanded."""

    def __init__(
        self, ros: Any, safety: int = WristState.SAFETY_NORMAL, arm: bool = True, require: str = "real",
        hears: bool = True,
    ) -> None:  # fmt: skip
        self.ros = ros
        self.tester = ros.node("tester")
        self.conductor = ros.add(
            Conductor(
                context=ros.context,
                parameter_overrides=[
                    Parameter("require", value=[require]),
                    Parameter("ready_timeout", value=0.5),
                ],
            )
        )
        self.wrist = ros.collect(WristCommand, "/command/wrist", 2000)
        self.vacuum = ros.collect(VacuumCommand, "/command/vacuum")
        self.strikes = ros.collect(StrikeMark, "/command/strike")
        self.feedback: list[Any] = []
        if arm:
            ros.arm(safety, hears)
        self.client = ActionClient(self.tester, PlayPhrase, "/play_phrase")
        ros.spin_until(self.client.server_is_ready, 30, "the action server")
        listeners = 1 + (arm and hears)
        ros.spin_until(lambda: self.conductor._wrist.get_subscription_count() == listeners, 30, "matched subscribers")

    def send(self, **request: Any) -> Any:
        future = self.client.send_goal_async(PlayPhrase.Goal(**request), lambda m: self.feedback.append(m.feedback))
        return self.ros.wait_for(future, 30, "the goal's acceptance")

    def result(self, handle: Any, deadline: float = 60.0) -> Any:
        return self.ros.wait_for(handle.get_result_async(), deadline, "the result")


def positions(messages: list[WristCommand]) -> np.ndarray:
    return np.array([[m.pose.position.x, m.pose.position.y, m.pose.position.z] for m in messages])


def test_a_phrase_becomes_setpoints_marks_and_vacuum(ros: Any) -> None:
    stage = Stage(ros)
    handle = stage.send(phrase_yaml=ONE)
    assert handle.accepted
    answer = stage.result(handle)
    assert answer.status == GoalStatus.STATUS_SUCCEEDED
    assert answer.result.success and answer.result.strikes == 1
    path = positions(stage.wrist)
    assert np.allclose(path[0], wrist_limits().home, atol=0.002), "the motion starts where the arm is"
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() < wrist_limits().speed * 0.05
    (mark,) = stage.strikes
    assert (mark.note, mark.finger, mark.speed) == (64, "middle", 0.2)
    assert common.seconds(mark.end) > common.seconds(mark.header.stamp)
    # The mark announces the strike before the wrist goes down.
    stamps = [common.seconds(m.header.stamp) for m in stage.wrist]
    low = stamps[int(np.argmin(path[:, 2]))]
    assert common.seconds(mark.header.stamp) < low < common.seconds(mark.end)
    assert list(stage.vacuum[-1].fingers) == ["thumb", "index", "middle"]
    assert stage.vacuum[-1].pressure[2] == -50e3
    assert stage.feedback and stage.feedback[-1].total == 1


def test_cancel_brings_the_wrist_up_and_at_rest(ros: Any) -> None:
    stage = Stage(ros)
    handle = stage.send(phrase_yaml=LONG)
    ros.spin_until(lambda: len(stage.feedback) >= 2, 30, "the second strike")
    ros.wait_for(handle.cancel_goal_async(), 30, "the cancel's answer")
    answer = stage.result(handle)
    assert answer.status == GoalStatus.STATUS_CANCELED
    assert "wrist is up" in answer.result.message
    # The answer may overtake the last setpoints.
    ros.spin_until(lambda: stage.wrist[-1].twist.linear.z == 0.0, 30, "a last setpoint at rest")
    path = positions(stage.wrist)
    assert path[-1, 2] > path[:, 2].min() + 0.02
    assert stage.send(phrase_yaml=ONE).accepted, "and the next phrase can be played"


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        ({"score": "nosuch"}, "unknown phrase"),
        ({"phrase_yaml": "strikes: [{note: 64, sped: 1}]"}, "did you mean 'speed'"),
        ({"phrase_yaml": "strikes: [{note: 84}]"}, "not on the keyboard"),
        ({}, "no score"),
    ],
)
def test_bad_scores_are_refused_in_words(ros: Any, request_: dict[str, str], words: str) -> None:
    stage = Stage(ros)
    answer = stage.result(stage.send(**request_))
    assert answer.status == GoalStatus.STATUS_ABORTED
    assert words in answer.result.message
    assert not stage.wrist, "nothing moves for a score that cannot be played"


def test_a_cell_that_is_not_there_is_named(ros: Any) -> None:
    stage = Stage(ros, arm=False)
    answer = stage.result(stage.send(phrase_yaml=ONE))
    assert "ur5_wrist" in answer.result.message and not stage.wrist


def test_a_stopped_arm_is_not_played_on(ros: Any) -> None:
    stage = Stage(ros, safety=WristState.SAFETY_PROTECTIVE_STOP)
    answer = stage.result(stage.send(phrase_yaml=ONE))
    assert "recover" in answer.result.message and not stage.wrist


@pytest.mark.parametrize(("phrase", "when"), [(ONE, "played to the end"), (LONG, "given up after")])
def test_an_arm_that_hears_nothing_has_not_played(ros: Any, phrase: str, when: str) -> None:
    answer = (stage := Stage(ros, hears=False)).result(stage.send(phrase_yaml=phrase))
    assert answer.status == GoalStatus.STATUS_ABORTED and not answer.result.success
    assert when in answer.result.message and "/command/wrist does not reach ur5_wrist" in answer.result.message


def test_a_second_goal_is_rejected_while_one_plays(ros: Any) -> None:
    stage = Stage(ros)
    first = stage.send(phrase_yaml=LONG)
    assert not stage.send(phrase_yaml=ONE).accepted
    ros.wait_for(first.cancel_goal_async(), 30)
    stage.result(first)
