"""One goal at a time: what is refused, how goals end, and that whatever happens the next goal may
come.
"""

from __future__ import annotations

import threading
from typing import Any

import pytest
from action_msgs.msg import GoalStatus
from pianobot_msgs.action import IdentifyKeystroke
from rclpy.action import ActionClient, ActionServer, CancelResponse

from pianobot_ros.nodes.base.jobs import JobClient, OneJob, background

pytestmark = pytest.mark.graph
ENDS = {
    "succeeded": GoalStatus.STATUS_SUCCEEDED,
    "canceled": GoalStatus.STATUS_CANCELED,
    "aborted": GoalStatus.STATUS_ABORTED,
}
LIMIT = 100.0  # s for any single step, on a busy machine
HELD_UP = 0.3  # s; an executor that is free takes an answer in less


class Stage:
    """A server with one job, whose work waits until the test lets it go on, and a client."""

    def __init__(self, ros: Any) -> None:
        self.ros = ros
        self.node = ros.node("worker")
        self.job = OneJob(self.node, "busy")
        self.begun, self.go_on = threading.Event(), threading.Event()
        self.end: str | Exception = "succeeded"
        self.server = ActionServer(
            self.node,
            IdentifyKeystroke,
            "/identify_keystroke",
            execute_callback=self.job.executes(self.work),
            goal_callback=self.job.accepts,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )
        self.client = ActionClient(ros.node("tester"), IdentifyKeystroke, "/identify_keystroke")
        ros.wait_for(self.client.server_is_ready, "the server", LIMIT)

    def work(self, goal: Any) -> tuple[str, Any]:
        self.begun.set()
        while not (self.go_on.wait(0.01) or self.job.stopping.is_set() or goal.is_cancel_requested):
            pass
        if isinstance(self.end, Exception):
            raise self.end
        ended = "canceled" if goal.is_cancel_requested else self.end
        return ended, IdentifyKeystroke.Result(message=threading.current_thread().name)

    def send(self) -> Any:
        future = self.client.send_goal_async(IdentifyKeystroke.Goal())
        return self.ros.wait_for(future, "an answer to the goal", LIMIT)

    def result(self, handle: Any) -> Any:
        return self.ros.wait_for(handle.get_result_async(), "the result", LIMIT)

    def close(self) -> None:
        self.go_on.set()
        self.job.close(5.0)
        self.server.destroy()
        self.client.destroy()


@pytest.fixture
def stage(ros: Any) -> Any:
    made = Stage(ros)
    yield made
    made.close()


def test_a_second_goal_is_refused_until_the_first_has_ended(stage: Stage) -> None:
    first = stage.send()
    stage.ros.wait_for(stage.begun.is_set, "the work", LIMIT)
    assert first.accepted and stage.job.busy
    assert not stage.send().accepted
    stage.go_on.set()
    answer = stage.result(first)
    assert answer.status == GoalStatus.STATUS_SUCCEEDED and not stage.job.busy
    assert answer.result.message == "goal", "done in a thread of its own"
    second = stage.send()
    assert second.accepted and stage.result(second).status == GoalStatus.STATUS_SUCCEEDED


@pytest.mark.parametrize("end", ["succeeded", "aborted"])
def test_a_goal_ends_as_its_work_says(stage: Stage, end: str) -> None:
    stage.end = end
    stage.go_on.set()
    assert stage.result(stage.send()).status == ENDS[end]


def test_a_cancel_reaches_the_work(stage: Stage) -> None:
    handle = stage.send()
    stage.ros.wait_for(handle.cancel_goal_async(), timeout=LIMIT)
    assert stage.result(handle).status == GoalStatus.STATUS_CANCELED
    assert not stage.job.busy


def test_work_that_raises_aborts_its_goal_and_no_other(stage: Stage) -> None:
    stage.end = ValueError("broken")
    stage.go_on.set()
    assert stage.result(stage.send()).status == GoalStatus.STATUS_ABORTED
    stage.end = "succeeded"
    assert stage.result(stage.send()).status == GoalStatus.STATUS_SUCCEEDED


def test_closing_ends_the_work_without_the_executor_and_refuses_what_comes_later(
    stage: Stage,
) -> None:
    stage.send()
    assert stage.begun.wait(LIMIT)
    stage.job.close(LIMIT)
    assert not stage.job.busy and not stage.send().accepted


def test_closing_does_not_wait_for_work_that_does_not_end(ros: Any) -> None:
    job = OneJob(ros.node("worker"), "busy")
    assert job.accepts(None).name == "ACCEPT" and job.accepts(None).name == "REJECT"
    job.close(0.05)
    assert job.busy and job.stopping.is_set()


def test_what_runs_in_the_background_returns_or_raises(ros: Any) -> None:
    node = ros.node("worker")
    assert ros.wait_for(background(node, lambda: 42, "sum"), timeout=LIMIT) == 42
    failed = background(node, lambda: 1 // 0, "division", low_priority=False)
    ros.wait_for(failed.done, "the failure", LIMIT)
    assert isinstance(failed.exception(), ZeroDivisionError)


class HeldUp:
    """A client's handle whose requests return late, so that their answers come first."""

    def __init__(self, client: Any) -> None:
        self._handle, self._answered = client._client_handle, threading.Event()
        self._execute, client.execute = client.execute, self.execute

    async def execute(self, taken: Any) -> None:
        await self._execute(taken)
        if taken.keys() & {"goal", "cancel", "result"}:
            self._answered.set()

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._handle, name)
        if name not in ("send_goal_request", "send_cancel_request", "send_result_request"):
            return found

        def send(request: Any) -> Any:
            self._answered.clear()
            number = found(request)
            self._answered.wait(HELD_UP)
            return number

        return send

    def __enter__(self) -> Any:
        return self._handle.__enter__()

    def __exit__(self, *what: Any) -> Any:
        return self._handle.__exit__(*what)


def test_an_answer_that_overtakes_its_request_is_kept(stage: Stage) -> None:
    """A thread asks while the executor spins: rclpy's own client drops such an answer."""
    client = JobClient(stage.ros.node("asking"), IdentifyKeystroke, "/identify_keystroke")
    stage.ros.wait_for(client.server_is_ready, "the server", LIMIT)
    client._client_handle = HeldUp(client)

    def asked(request: Any) -> Any:
        sent = stage.ros.wait_for(background(stage.node, request, "asking"), "the request", LIMIT)
        return stage.ros.wait_for(sent, "its answer", LIMIT)

    handle = asked(lambda: client.send_goal_async(IdentifyKeystroke.Goal()))
    assert handle.accepted
    assert asked(handle.cancel_goal_async).goals_canceling
    assert asked(handle.get_result_async).status == GoalStatus.STATUS_CANCELED
    client.destroy()
