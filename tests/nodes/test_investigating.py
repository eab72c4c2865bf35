"""The action /investigate with a conductor, a twin and a diagnosis that are stand-ins: what is
played, what is told on the way, and what a cancel leaves.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from types import SimpleNamespace
from typing import Any

import pytest
from pianobot_msgs.action import Investigate, PlayPhrase
from pianobot_msgs.msg import Diagnosis, GapReport, KeystrokeGap, SignalGap
from pianobot_msgs.srv import Adopt
from rclpy.action import ActionClient, ActionServer, CancelResponse
from std_srvs.srv import Trigger

from pianobot_ros.cell.recordings.recording import Strike
from pianobot_ros.cell.score import load_score
from pianobot_ros.nodes.analysis.investigating import Investigating
from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.base.jobs import OneJob
from pianobot_ros.piano.gap.diagnosis.investigate import Decision
from pianobot_ros.piano.gap.diagnosis.live import Collector

pytestmark = pytest.mark.graph

STRIKES = 3  # of every phrase


def diagnosis(probability: float) -> Any:
    """As much of a diagnosis as the action looks at."""
    names = (("hammer", probability), ("let_off", 1.0 - probability))
    candidates = [SimpleNamespace(name=n, stage="key", probability=p) for n, p in names]
    document = {
        "verdict": "parameters",
        "sentence": f"hammer {probability:.0%}",
        "parameters": {"joint_stiffness": {"value": 1.2, "unit": "1"}},
    }
    return SimpleNamespace(
        candidates=candidates, sentence=document["sentence"], to_json=lambda: document
    )


class Stage:
    """The rest of the graph: a conductor whose strikes are seen at once, a twin, and a worker that
    gets surer from round to round.
    """

    def __init__(
        self, ros: Any, certainty: list[float], *, worse: bool = False, free: int = 9
    ) -> None:
        """``worse``: what the twin adopts does harm; ``free`` phrases end by themselves, further
        ones go on until they are cancelled."""
        self.node = ros.node("stage")
        self.played: list[PlayPhrase.Goal] = []
        self.asked: list[str] = []
        self.cancelled, self._free = False, free
        self._left, self._worse, self._adopted = iter(certainty), worse, False
        self.signals = SimpleNamespace(lock=threading.Lock(), collector=Collector())
        self._reports = self.node.create_publisher(GapReport, "/gap/live", common.EVENT_QOS)
        conductor = ros.node("conductor")
        self.server = ActionServer(
            conductor,
            PlayPhrase,
            "/play_phrase",
            execute_callback=OneJob(conductor, "").executes(self._play),
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )
        self.node.create_service(Adopt, "/sim_twin/adopt", self._adopt)
        self.node.create_service(Trigger, "/sim_twin/forget", self._forget)
        node = ros.node("gap_diagnoser")
        job = OneJob(node, "busy")
        process = SimpleNamespace(submit=self._submit, restart=lambda: self.asked.append("restart"))
        self.room = Investigating(node, self.signals, -0.9, job, process, self._message)  # type: ignore[arg-type]
        self.action = ActionServer(
            node,
            Investigate,
            "/investigate",
            execute_callback=job.executes(self.room.run),
            goal_callback=job.accepts,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )
        ros.matched(self._reports)

    def close(self) -> None:
        """Leave the graph: an action outlives its node."""
        self.room.close()
        self.action.destroy()
        self.server.destroy()

    def _message(self, document: Any) -> Diagnosis:
        return Diagnosis(verdict=document["verdict"], sentence=document["sentence"])

    def _play(self, goal: Any) -> tuple[str, PlayPhrase.Result]:
        self.played.append(goal.request)
        while len(self.played) > self._free:
            if goal.is_cancel_requested:
                self.cancelled = True
                return "canceled", PlayPhrase.Result()
            time.sleep(0.01)
        now = time.time()
        self.signals.collector = Collector()  # what is seen live is forgotten after a while
        for i in range(STRIKES):
            begin = now + 1e-3 * i
            self.signals.collector.strike(
                Strike(i, "", "a", "middle", 64, begin, begin, 0.1, 0.01, 0.1, 0.0, 1.0)
            )
            rms = 4.0 if self._adopted and self._worse else 1.0 if self._adopted else 2.0
            signals = [SignalGap(signal="z", rms=rms, floor=0.5)]
            stroke = KeystrokeGap(condition="a", err=0.1)
            report = GapReport(signals=signals, keystrokes=[stroke])
            report.header.stamp = common.time_msg(time.time_ns())
            self._reports.publish(report)
        return "succeeded", PlayPhrase.Result(success=True, strikes=STRIKES)

    def _submit(self, function: Any, recordings: Any, *wanted: Any) -> Any:
        self.known = [len(r.strikes) for r in recordings]
        probability = next(self._left)
        future: Future[Decision] = Future()
        sure = probability >= wanted[0]
        phrase = {} if sure else {"name": "more", "strikes": []}
        purpose = "sure" if sure else "to tell apart hammer and let_off"
        future.set_result(
            Decision(diagnosis(probability), "goal" if sure else "", phrase, purpose=purpose)
        )
        return future

    def _adopt(self, request: Adopt.Request, answer: Adopt.Response) -> Adopt.Response:
        assert "joint_stiffness" in request.corrections
        self.asked.append("adopt")
        self._adopted = answer.success = True
        return answer

    def _forget(self, _: Any, answer: Trigger.Response) -> Trigger.Response:
        self.asked.append("forget")
        answer.success = True
        return answer


@pytest.fixture
def stages(ros: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Stage]]:
    """Makes stages, and ends them."""
    made: list[Stage] = []
    # As long as a busy machine takes to bring the comparisons: it is not they that are missing.
    monkeypatch.setattr("pianobot_ros.nodes.analysis.investigating.LAST_REPORT", 60.0)

    def make(*arguments: Any, **options: Any) -> Stage:
        made.append(Stage(ros, *arguments, **options))
        return made[-1]

    yield make
    for stage in made:
        stage.close()


def ask(ros: Any, feedback: list[Any], **request: Any) -> tuple[ActionClient, Any]:
    """Send a goal and wait until it is accepted."""
    client = ActionClient(ros.node("client"), Investigate, "/investigate")
    ros.wait_for(client.server_is_ready, "the action")
    sent = client.send_goal_async(
        Investigate.Goal(**request), lambda m: feedback.append(m.feedback)
    )
    return client, ros.wait_for(sent, "the goal's acceptance")


def test_it_plays_on_until_the_goal_and_says_what_for(ros: Any, stages: Any) -> None:
    stage, feedback = stages([0.6, 0.97]), []
    client, goal = ask(ros, feedback, score="demo", budget_strikes=40, goal=0.95)
    result = ros.wait_for(goal.get_result_async(), "the result").result
    ros.wait_for(
        lambda: feedback and feedback[-1].purpose == "sure", "the feedback, which it may overtake"
    )
    assert (result.success, result.ended, result.strikes) == (True, "goal", 2 * STRIKES)
    assert result.diagnosis.sentence == "hammer 97%"
    assert stage.known == [STRIKES, STRIKES]
    assert [bool(p.phrase_yaml) for p in stage.played] == [False, True]
    assert stage.played[0].score == "demo" and "name: more" in stage.played[1].phrase_yaml
    assert {f.doing for f in feedback} == {"playing", "diagnosing"} and feedback[-1].budget == 40
    leading = [f.leading[0].probability for f in feedback if f.leading]
    assert leading[0] == 0.6 and leading[-1] == 0.97
    purposes = [f.purpose for f in feedback if f.leading]
    assert purposes[0] == "to tell apart hammer and let_off" and purposes[-1] == "sure"
    assert stage.asked == []  # nothing is adopted unasked
    client.destroy()


@pytest.mark.parametrize("score", ["", "two_note"])
def test_a_budget_below_the_first_set_is_refused_before_anything_is_played(
    ros: Any, stages: Any, score: str
) -> None:
    stage, least = stages([0.6]), len(load_score(score or "demo").places)
    client, goal = ask(ros, [], score=score, budget_strikes=least - 1)
    result = ros.wait_for(goal.get_result_async(), "the result").result
    assert not result.success and result.ended == "failed"
    assert f"has {least}; give as many, or a shorter score" in result.message
    assert not stage.played
    client.destroy()


@pytest.mark.parametrize("wanted", [7.0, 1.0, -0.9, 0.3, float("nan")])
def test_a_goal_that_no_explanation_reaches_is_refused_before_anything_is_played(
    ros: Any, stages: Any, wanted: float
) -> None:
    """Whoever asks: a program beside the command line, too."""
    stage = stages([0.6])
    client, goal = ask(ros, [], score="demo", goal=wanted)
    result = ros.wait_for(goal.get_result_async(), "the result").result
    assert not result.success and result.ended == "failed"
    assert "0.5 to 0.999, or 0 for 0.95" in result.message
    assert not stage.played
    client.destroy()


def test_cancel_stops_the_phrase_and_keeps_the_verdict_so_far(ros: Any, stages: Any) -> None:
    stage, feedback = stages([0.6, 0.6], free=1), []
    client, goal = ask(ros, feedback, goal=0.95)
    ros.wait_for(lambda: len(stage.played) > 1, "the next phrase")
    ros.wait_for(goal.cancel_goal_async(), "the cancel's answer")
    answer = ros.wait_for(goal.get_result_async(), "the cancelled result")
    assert (answer.result.ended, answer.result.success) == ("cancelled", False)
    assert answer.result.diagnosis.sentence == "hammer 60%"
    assert answer.result.strikes == STRIKES
    ros.wait_for(lambda: stage.cancelled, "the phrase's end")
    client.destroy()


@pytest.mark.parametrize("worse", [False, True])
def test_what_makes_an_unheard_phrase_worse_is_forgotten(
    ros: Any, stages: Any, worse: bool
) -> None:
    stage = stages([0.97], worse=worse)
    client, goal = ask(ros, [], goal=0.95, adopt=True)
    result = ros.wait_for(goal.get_result_async(), "the result").result
    assert [p.score for p in stage.played] == ["demo", "unheard", "unheard"]
    assert stage.asked == (["adopt", "forget"] if worse else ["adopt"])
    assert ("forgotten" in result.message) == worse
    assert "4.00" in result.message and result.strikes == STRIKES
    client.destroy()
