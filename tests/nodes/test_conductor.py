"""The conductor between a hand-made arm (states published by the test) and recorded commands."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from pianobot_msgs.action import PlayPhrase
from pianobot_msgs.msg import MidiEvent, StrikeMark, VacuumCommand, WristCommand, WristState
from rclpy.action import ActionClient
from rclpy.parameter import Parameter
from standing_arm import standing_arm

from pianobot_ros.cell.messages.stamps import nanoseconds
from pianobot_ros.cell.motion.limits import wrist_limits
from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.playing.conductor import Conductor
from pianobot_ros.nodes.session.refused_commands import RefusalPublisher
from pianobot_ros.nodes.topics.polled import PolledSubscription, Watch
from pianobot_ros.testing import wait_for

pytestmark = [pytest.mark.graph, pytest.mark.slow]

ONE = "strikes: [{note: 64, speed: 0.2, depth: 0.014, hold: 0.05}]"
LONG = "defaults: {note: 64, repeats: 40}\nstrikes: [{speed: 0.1}]"


class Stage:
    """A conductor, an arm that says where it is, and everything that is commanded."""

    def __init__(
        self,
        ros: Any,
        safety: int = WristState.SAFETY_NORMAL,
        arm: bool = True,
        require: str = "real",
        hears: bool = True,
    ) -> None:
        self.ros = ros
        self.tester = ros.node("tester")
        self.conductor = ros.add(
            Conductor(
                context=ros.context,
                parameter_overrides=[
                    Parameter("require", value=[require]),
                    # What is there may take its time; what is missing never comes, and what is
                    # stopped stays so.
                    Parameter("ready_timeout", value=20.0 if arm and safety == 1 else 0.5),
                ],
            )
        )
        self.wrist = ros.record(WristCommand, "/command/wrist", 2000)
        self.vacuum = ros.record(VacuumCommand, "/command/vacuum")
        self.strikes = ros.record(StrikeMark, "/command/strike")
        self.feedback: list[Any] = []
        self.arm = standing_arm(ros, safety, hears) if arm else None
        if arm:
            self._see_the_arm()
        self.client = ActionClient(self.tester, PlayPhrase, "/play_phrase")
        ros.wait_for(self.client.server_is_ready, "the action server")
        listeners = 1 + (arm and hears)
        streamer = self.conductor._streamer
        ros.matched(streamer.wrist, listeners=listeners)
        ros.matched(streamer._vacuum, streamer._strike)

    def _see_the_arm(self) -> None:
        """Have the conductor wait for the arm's state, however late that is, before it asks what is
        wrong with it.
        """
        cells, forget = self.conductor._cells, self.conductor._cells.forget

        def seen() -> bool:
            cells.look()
            return "real" in cells._states

        def forget_and_see() -> None:
            forget()
            wait_for(seen, "the arm's state")

        cells.forget = forget_and_see

    def send(self, **request: Any) -> Any:
        future = self.client.send_goal_async(
            PlayPhrase.Goal(**request), lambda m: self.feedback.append(m.feedback)
        )
        return self.ros.wait_for(future, "the goal's acceptance")

    def result(self, handle: Any, deadline: float = 200.0) -> Any:
        return self.ros.wait_for(handle.get_result_async(), "the result", deadline)

    def judge_once(self, heard: Callable[[Any], Any]) -> None:
        """Have the conductor judge a passage's strikes once ``heard``, asked with the passage,
        holds: whoever answers it here may be held up for longer than it waits for an answer.
        """
        conductor, judge = self.conductor, self.conductor._lost

        def judged(plan: Any, take: Any, audible: Any) -> Any:
            def listened() -> Any:
                conductor._notes.look()
                conductor._refusals.take()
                return heard(take)

            wait_for(listened, "what the strikes are judged by")
            return judge(plan, take, audible)

        conductor._lost = judged

    def all_setpoints(self) -> None:
        """Wait for what was sent before an answer that has overtaken it."""
        sent = self.conductor._streamer.sent
        self.ros.wait_for(lambda: len(self.wrist) == sent, "all setpoints")


@pytest.fixture
def trusting(monkeypatch: pytest.MonkeyPatch) -> None:
    """A conductor that does not blame an arm for a busy machine."""
    monkeypatch.setattr("pianobot_ros.nodes.playing.cells.STATE_FRESH", 60.0)


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch, trusting: None) -> None:
    """A conductor that blames no strike on a busy machine either. It waits for no note: whoever
    plays them has the strikes judged once they are there (`Stage.judge_once`).
    """
    monkeypatch.setattr("pianobot_ros.nodes.playing.conductor.ARRIVAL", 0.0)
    for name in ("LATE", "STATE_FRESH"):
        monkeypatch.setattr(f"pianobot_ros.nodes.playing.streaming.{name}", 60.0)


def positions(messages: list[WristCommand]) -> np.ndarray:
    return np.array([[m.pose.position.x, m.pose.position.y, m.pose.position.z] for m in messages])


def test_a_phrase_becomes_setpoints_marks_and_vacuum(ros: Any, patient: None) -> None:
    stage = Stage(ros)
    handle = stage.send(phrase_yaml=ONE)
    assert handle.accepted
    answer = stage.result(handle)
    assert answer.status == GoalStatus.STATUS_SUCCEEDED
    assert answer.result.success and answer.result.strikes == 1
    stage.all_setpoints()
    ros.wait_for(lambda: stage.strikes and stage.feedback, "the strike, announced and played")
    ros.wait_for(lambda: stage.vacuum and stage.vacuum[-1].pressure[2] == -50e3, "the vacuum")
    path = positions(stage.wrist)
    assert np.allclose(path[0], wrist_limits().home, atol=0.002), (
        "the motion starts where the arm is"
    )
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() < wrist_limits().speed * 0.05
    (mark,) = stage.strikes
    assert (mark.note, mark.finger, mark.speed) == (64, "middle", 0.2)
    assert common.seconds(mark.end) > common.seconds(mark.header.stamp)
    # The mark announces the strike before the wrist goes down.
    stamps = [common.seconds(m.header.stamp) for m in stage.wrist]
    low = stamps[int(np.argmin(path[:, 2]))]
    assert common.seconds(mark.header.stamp) < low < common.seconds(mark.end)
    assert list(stage.vacuum[-1].fingers) == ["thumb", "index", "middle"]
    assert stage.feedback[-1].total == 1


def test_cancel_brings_the_wrist_up_and_at_rest(ros: Any, patient: None) -> None:
    stage = Stage(ros)
    handle = stage.send(phrase_yaml=LONG)
    ros.wait_for(lambda: len(stage.feedback) >= 2, "the second strike")
    ros.wait_for(handle.cancel_goal_async(), "the cancel's answer")
    answer = stage.result(handle)
    assert answer.status == GoalStatus.STATUS_CANCELED
    assert "wrist is up" in answer.result.message
    stage.all_setpoints()
    assert stage.wrist[-1].twist.linear.z == 0.0, "a last setpoint at rest"
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


def test_a_stopped_arm_is_not_played_on(ros: Any, trusting: None) -> None:
    stage = Stage(ros, safety=WristState.SAFETY_PROTECTIVE_STOP)
    answer = stage.result(stage.send(phrase_yaml=ONE))
    assert "recover" in answer.result.message and not stage.wrist


@pytest.mark.parametrize(("phrase", "when"), [(ONE, "played to the end"), (LONG, "given up after")])
def test_an_arm_that_hears_nothing_has_not_played(
    ros: Any, trusting: None, phrase: str, when: str
) -> None:
    answer = (stage := Stage(ros, hears=False)).result(stage.send(phrase_yaml=phrase))
    assert answer.status == GoalStatus.STATUS_ABORTED and not answer.result.success
    assert (
        when in answer.result.message
        and "ur5_wrist does not hear /command/wrist" in answer.result.message
    )


def test_an_arm_that_refuses_is_given_its_own_reason(ros: Any, trusting: None) -> None:
    """After ~/stop it was said that the setpoints did not reach the node."""
    stage = Stage(ros, hears=False)
    arm = RefusalPublisher(ros.node("stopped"), "real")
    ros.matched(arm._publisher)
    handle = stage.send(phrase_yaml=LONG)
    ros.wait_for(lambda: stage.feedback, "the first strike")
    arm.refuse("/command/wrist", common.time_msg(time.time_ns()), "the arm was stopped on request")
    answer = stage.result(handle)
    assert "the arm was stopped on request" in answer.result.message


class Piano:
    """Both cells' notes, made from the strike marks; ``swallows`` are running numbers of strikes
    that the real one does not hear."""

    def __init__(self, ros: Any, swallows: set[int]) -> None:
        node = ros.node("piano")
        self._out = {
            cell: node.create_publisher(MidiEvent, f"/{cell}/midi", common.EVENT_QOS)
            for cell in ("real", "sim")
        }
        self._swallows, self._node = swallows, node
        marks = PolledSubscription(node, StrikeMark, "/command/strike", common.EVENT_QOS)
        Watch(marks, self._strike, 0.02)  # until the node's end, beside the test's executor

    def matched(self, stage: Stage) -> None:
        """Wait until the conductor and this piano hear each other; no strike is judged before this
        piano has answered it.
        """
        stage.ros.matched(*self._out.values())
        stage.ros.matched(stage.conductor._streamer._strike, listeners=2)
        notes, first = stage.conductor._notes.events, 0

        def answered(take: Any) -> bool:
            strikes = range(first + take.announced)
            due = {"sim": len(strikes), "real": len(set(strikes) - self._swallows)}
            return all(len(notes[cell]) >= 2 * count for cell, count in due.items())

        def heard(take: Any) -> bool:
            nonlocal first
            whole = answered(take)
            first += take.announced if whole else 0
            return whole

        stage.judge_once(heard)

    def dies(self, cell: str) -> None:
        """Nobody publishes the notes of a cell any more."""
        self._node.destroy_publisher(self._out.pop(cell))

    def _strike(self, mark: StrikeMark) -> None:
        for cell, out in list(self._out.items()):
            if cell == "sim" or mark.index not in self._swallows:
                for status, after in ((144, 0.05), (128, 0.1)):
                    event = MidiEvent(status=status, note=mark.note, velocity=50)
                    at = common.seconds(mark.header.stamp) + after
                    event.header.stamp = common.time_msg(round(1e9 * at))
                    out.publish(event)


TWO = "defaults: {note: 64, depth: 0.014, hold: 0.05}\nstrikes: [{speed: 0.2}, {speed: 0.15}]"


@pytest.mark.parametrize(
    ("swallows", "played", "lost"),
    [
        ({0}, 3, 0),
        pytest.param({0, 1, 2, 4}, 5, 1, marks=pytest.mark.long),
        pytest.param(set(range(9)), 6, 2, marks=pytest.mark.long),
    ],
)
def test_a_strike_that_fell_silent_is_played_again_at_most_twice(
    ros: Any, patient: None, swallows: set[int], played: int, lost: int
) -> None:
    stage = Stage(ros)
    Piano(ros, swallows).matched(stage)
    ros.wait_for(lambda: stage.conductor._notes.present() == ["real", "sim"], "the notes")
    answer = stage.result(stage.send(phrase_yaml=TWO))
    assert answer.result.success and answer.result.strikes == played, answer.result.message
    ros.wait_for(lambda: len(stage.strikes) >= played, "every announcement")
    assert [mark.index for mark in stage.strikes] == list(range(played)), "numbers go on"
    first = stage.strikes[0]
    assert (stage.strikes[2].condition, stage.strikes[2].speed) == (first.condition, first.speed)
    assert len(answer.result.unreachable) == lost
    assert all("silent on the real cell" in line for line in answer.result.unreachable)
    assert ("lost" in answer.result.message) == bool(lost)


def test_a_cell_whose_notes_nobody_publishes_is_named(ros: Any, patient: None) -> None:
    """The bridge had died, and the phrase counted as played."""
    stage = Stage(ros)
    answer = stage.result(stage.send(phrase_yaml=ONE))
    assert answer.result.success and "nobody publishes notes" in answer.result.message


def test_a_cell_that_falls_silent_for_good_has_not_played(ros: Any, patient: None) -> None:
    stage = Stage(ros)
    # It swallows all, else the first strike may sound before the test hears of it.
    piano = Piano(ros, set(range(9)))
    piano.matched(stage)
    ros.wait_for(lambda: stage.conductor._notes.present() == ["real", "sim"], "the notes")
    handle = stage.send(phrase_yaml=TWO)
    ros.wait_for(lambda: stage.strikes, "the first strike's announcement")
    piano.dies("real")
    answer = stage.result(handle)
    assert len(answer.result.unreachable) == 2, answer.result.message
    assert all("silent on the real cell" in line for line in answer.result.unreachable)


def test_a_strike_in_which_the_arm_fell_behind_is_played_again(ros: Any, patient: None) -> None:
    stage = Stage(ros)
    arm = RefusalPublisher(ros.node("late"), "real")
    ros.matched(arm._publisher)
    stage.judge_once(lambda _: stage.conductor._refusals._heard["real"])
    handle = stage.send(phrase_yaml=TWO)
    ros.wait_for(lambda: stage.strikes, "the first strike's announcement")
    (first, *_) = stage.strikes
    at = nanoseconds(first.header.stamp) + 200_000_000
    arm.behind("/command/wrist", at, 0.04)
    arm.behind("/command/wrist", at + 10_000_000, 0.03)  # the same one still
    assert arm.late == 1
    answer = stage.result(handle)
    assert answer.result.success and answer.result.strikes == 3, answer.result.message
    ros.wait_for(lambda: len(stage.strikes) == 3, "the last announcement")
    assert stage.strikes[2].condition == first.condition and not answer.result.unreachable


def test_what_an_arm_missed_for_a_while_is_played_when_it_is_back(
    ros: Any, patient: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    # two strikes take nearly as long as an arm is waited for: on a busy machine it was given up
    monkeypatch.setattr("pianobot_ros.nodes.playing.streaming.BLIND", 60.0)
    stage = Stage(ros)
    stage.arm.controller_time, stage.arm.program_running = 1.0, True
    handle = stage.send(phrase_yaml=LONG.replace("40", "12"))
    ros.wait_for(lambda: len(stage.feedback) >= 2, "the second strike")
    stage.arm.program_running = False
    known = stage.conductor._cells._states
    ros.wait_for(lambda: not known["real"][1].program_running, "the conductor to see it")
    begun = len(stage.feedback)  # one of a strike before may be on the way still
    ros.wait_for(lambda: len(stage.feedback) > begun + 1, "a strike that the arm misses")
    stage.arm.program_running = True
    answer = stage.result(handle)
    assert answer.result.success and answer.result.strikes > 12, answer.result.message
    assert not answer.result.unreachable


def test_a_second_goal_is_rejected_while_one_plays(ros: Any, patient: None) -> None:
    stage = Stage(ros)
    first = stage.send(phrase_yaml=LONG)
    assert not stage.send(phrase_yaml=ONE).accepted
    ros.wait_for(first.cancel_goal_async())
    stage.result(first)
