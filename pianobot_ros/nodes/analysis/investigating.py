"""The action ``/investigate`` of ``gap_diagnoser``: play, diagnose, play what tells most, again.

The strikes are played by the conductor like any phrase, within the same limits. A cancelled goal
stops the phrase that is being played and keeps the last diagnosis.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import Any, Protocol

from pianobot_msgs.action import Investigate, PlayPhrase
from pianobot_msgs.msg import Candidate, Diagnosis, GapReport
from pianobot_msgs.srv import Adopt
from rclpy.node import Node
from std_srvs.srv import Trigger

from pianobot_ros.cell.errors import PianobotError, ScoreError
from pianobot_ros.cell.numbers.bounded_files import yaml_text
from pianobot_ros.cell.numbers.default_budgets import (
    INVESTIGATION_GOAL,
    INVESTIGATION_GOALS,
    INVESTIGATION_STRIKES,
)
from pianobot_ros.cell.recordings.before_after import LAST_REPORT, UNHEARD, heard, is_worse
from pianobot_ros.cell.recordings.recording import Recording
from pianobot_ros.cell.score import load_score
from pianobot_ros.nodes.analysis.live_signals import LiveSignals
from pianobot_ros.nodes.base.common import EVENT_QOS, seconds
from pianobot_ros.nodes.base.jobs import JobClient, OneJob, cancel
from pianobot_ros.piano.gap.diagnosis.live import decide_in_worker, write_found

__all__ = ["ComputeProcess", "Investigating"]

FIRST = "demo"  # the phrase of the first set, where none is asked for
CONDUCTOR = 10.0  # s to wait for the conductor, or for the twin
LOOK = 0.1  # s between two looks at what is going on


class ComputeProcess(Protocol):
    """Where something is computed."""

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """The result to come of ``function(*arguments)``."""

    def restart(self) -> None:
        """End what is being computed."""


class _Ended(Exception):  # noqa: N818 (no error: somebody asked for it)
    """The goal was cancelled, or the node ends."""


def _probability(asked: float) -> float:
    """The probability at which it is enough; raises PianobotError for one that is none."""
    least, largest = INVESTIGATION_GOALS
    if asked and not least <= asked <= largest:
        raise PianobotError(
            f"goal is {asked:g}: give the probability of one explanation at which it is enough,"
            f" {least:g} to {largest:g}, or 0 for {INVESTIGATION_GOAL:g}"
        )
    return asked or INVESTIGATION_GOAL


def _refuse_too_little(score: str, budget: int) -> None:
    """Raise PianobotError where the first set has more strikes than may be played in all."""
    try:
        least = len(load_score(score).places)
    except ScoreError:  # the conductor, which may transpose it, is the one to judge
        return
    if budget < least:
        raise PianobotError(
            f"a budget of {budget} strikes is less than the first set: '{score}' has {least}; give"
            " as many, or a shorter score"
        )


class Investigating:
    """Carries out goals of Investigate.

    Args:
        node: whose executor turns this.
        signals: the strikes as they come.
        settled: s after a strike's window in which its samples still arrive.
        job: which goal is being carried out.
        process: who computes.
        message: the message of a diagnosis.json.
    """

    def __init__(
        self,
        node: Node,
        signals: LiveSignals,
        settled: float,
        job: OneJob,
        process: ComputeProcess,
        message: Callable[[Mapping[str, Any]], Diagnosis],
    ) -> None:
        self._node, self._signals, self._settled = node, signals, settled
        self._job, self._process, self._message = job, process, message
        self._player = JobClient(node, PlayPhrase, "/play_phrase")
        self._adopt = node.create_client(Adopt, "/sim_twin/adopt")
        self._forget = node.create_client(Trigger, "/sim_twin/forget")
        self._reports: deque[GapReport] = deque(maxlen=500)
        node.create_subscription(GapReport, "/gap/live", self._compared, EVENT_QOS)

    def _compared(self, report: GapReport) -> None:
        self._reports.append(report)

    def close(self) -> None:
        """Leave the graph."""
        self._player.destroy()

    def run(self, goal: Any) -> tuple[str, Investigate.Result]:
        """One goal; how it ended and its result."""
        result = Investigate.Result(ended="failed")
        try:
            self._investigate(goal, result)
        except _Ended:
            result.ended = result.message = "cancelled"
            return ("canceled" if goal.is_cancel_requested else "aborted"), result
        except PianobotError as error:
            result.message = str(error)
            self._node.get_logger().error(f"investigation: {error}")
            return "aborted", result
        except Exception as error:  # of the worker, say: whoever asked is told
            result.message = f"the investigation failed: {type(error).__name__}: {error}"
            self._node.get_logger().error(result.message)
            return "aborted", result
        result.success = True
        return "succeeded", result

    def _investigate(self, goal: Any, result: Investigate.Result) -> None:
        request = goal.request
        budget = int(request.budget_strikes) or INVESTIGATION_STRIKES
        _refuse_too_little(score := request.score or FIRST, budget)
        wanted = (_probability(request.goal), budget, int(request.seed))
        played: list[Recording] = []  # each kept: what is seen live is forgotten after a while
        feedback = Investigate.Feedback(budget=budget, purpose="the first set")
        phrase: dict[str, Any] = {"score": score}
        while True:
            feedback.doing = "playing"
            self._tell(goal, feedback)
            began = time.time()
            self._play(goal, phrase)
            feedback.doing = "diagnosing"
            played.append(self._recording(goal, began))
            feedback.strikes = result.strikes = sum(len(r.strikes) for r in played)
            self._tell(goal, feedback)
            decision = self._await(goal, self._process.submit(decide_in_worker, played, *wanted))
            if request.output:
                report = self._process.submit(write_found, decision.diagnosis, request.output)
                result.report = str(self._await(goal, report))
            document = {**decision.diagnosis.to_json(), "report": result.report}
            result.diagnosis = self._message(document)
            feedback.leading = [
                Candidate(name=c.name, stage=c.stage, probability=c.probability)
                for c in decision.diagnosis.candidates[:3]
            ]
            feedback.purpose = decision.purpose
            self._tell(goal, feedback)
            if decision.ended:
                break
            text = yaml_text(decision.phrase)
            phrase = {"phrase_yaml": text}
        result.ended = decision.ended
        result.message = f"{decision.diagnosis.sentence} ({decision.purpose})"
        if request.adopt:
            outcome = self._adopted(goal, feedback, decision.diagnosis.to_json(), played[-1])
            result.message += "; " + outcome

    def _tell(self, goal: Any, feedback: Investigate.Feedback) -> None:
        feedback.progress = min(1.0, feedback.strikes / max(feedback.budget, 1))
        goal.publish_feedback(feedback)

    def _await(self, goal: Any, future: Any, limit: float = float("inf")) -> Any:
        """The result of a future; ends the computing if the goal is cancelled meanwhile."""
        end = time.monotonic() + limit
        while not future.done():
            if goal.is_cancel_requested or self._job.stopping.is_set():
                self._process.restart()
                raise _Ended
            if time.monotonic() > end:
                raise PianobotError("no answer in time from the conductor or the twin")
            self._job.stopping.wait(LOOK)
        return future.result()

    def _pause(self, goal: Any) -> None:
        """A moment, unless it is all to end."""
        if goal.is_cancel_requested or self._job.stopping.is_set():
            raise _Ended
        self._job.stopping.wait(LOOK)

    def _play(self, goal: Any, phrase: Mapping[str, str]) -> PlayPhrase.Result:
        if not self._player.wait_for_server(timeout_sec=CONDUCTOR):
            raise PianobotError("the conductor does not answer: is the cell running?")
        sent = self._player.send_goal_async(PlayPhrase.Goal(**phrase))
        try:
            handle = self._await(goal, sent, CONDUCTOR)
        except (_Ended, PianobotError):
            # the conductor may have begun all the same: its answer is still on the way
            sent.add_done_callback(cancel)
            raise
        if not handle.accepted:
            raise PianobotError("the conductor is playing already: cancel that phrase first")
        playing = handle.get_result_async()
        while not playing.done():
            if goal.is_cancel_requested or self._job.stopping.is_set():
                handle.cancel_goal_async()
                raise _Ended
            self._job.stopping.wait(LOOK)
        played: PlayPhrase.Result = playing.result().result
        if not played.success:
            raise PianobotError(f"the phrase was not played: {played.message}")
        return played

    def _recording(self, goal: Any, began: float) -> Recording:
        """All strikes since ``began``, once the last one's samples are there."""
        end = time.monotonic() + self._settled + 1.0
        while time.monotonic() < end:
            self._pause(goal)
        with self._signals.lock:
            collector = self._signals.collector
            strikes = [s for s in collector.finished(time.time()) if s.start >= began]
            if not strikes:
                raise PianobotError("no strike of the phrase was seen")
            return collector.recording(strikes)

    def _adopted(
        self, goal: Any, feedback: Investigate.Feedback, found: Mapping[str, Any], seen: Recording
    ) -> str:
        """Adopt the verdict, with a phrase that was not used before and after; what made that worse
        is forgotten. Says what was done.
        """
        from pianobot_ros.piano.gap.adoption.adopt import adoption  # loads the library of effects

        verdict = adoption(found)
        if not verdict.corrections:
            return verdict.sentence
        if not self._adopt.wait_for_service(timeout_sec=CONDUCTOR):
            return "the twin does not answer: nothing was adopted"
        before = self._test(goal, feedback, "a phrase that was not used, before adopting")
        answer = self._ask_twin(goal, verdict.corrections.to_yaml())
        if not answer.success:
            return str(answer.message)
        after = self._test(goal, feedback, "a phrase that was not used, after adopting")
        first, second = heard(before, after), heard(after, before)
        if math.isnan(first.gap) or math.isnan(second.gap):
            return f"{verdict.sentence}; nobody compared the cells, so it was not tested"
        gaps = (
            f"the gap of a phrase that was not used: {first.gap:.2f}, now {second.gap:.2f} floors;"
            f" its Err: {100 * first.err:.1f} %, now {100 * second.err:.1f} %"
        )
        if not is_worse(first, second):
            return f"{verdict.sentence}; {gaps}"
        self._await(goal, self._forget.call_async(Trigger.Request()), CONDUCTOR)
        if seen.corrections:  # what it had before
            self._ask_twin(goal, seen.corrections)
        return f"{gaps}: that is worse, so the twin has forgotten it ({verdict.sentence})"

    def _ask_twin(self, goal: Any, corrections: str) -> Adopt.Response:
        request = Adopt.Request(corrections=corrections)
        answer: Adopt.Response = self._await(goal, self._adopt.call_async(request), CONDUCTOR)
        return answer

    def _test(self, goal: Any, feedback: Investigate.Feedback, purpose: str) -> list[GapReport]:
        """Play the unheard phrase; the comparisons of its strikes."""
        feedback.doing, feedback.purpose = "playing", purpose
        self._tell(goal, feedback)
        begun = time.time()
        strikes = self._play(goal, {"score": UNHEARD}).strikes
        end = time.monotonic() + self._settled + LAST_REPORT
        while len(found := self._since(begun)) < strikes and time.monotonic() < end:
            self._pause(goal)
        return found

    def _since(self, begun: float) -> list[GapReport]:
        """Comparisons of strikes that ended after ``begun``, s since the epoch: one of an earlier
        phrase may come late.
        """
        reports = list(self._reports)
        return [r for r in reports if seconds(r.header.stamp) - r.latency > begun]
