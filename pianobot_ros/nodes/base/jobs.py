"""Long work beside a spinning executor: threads whose end is awaited, goals of which one at a time
is carried out, and a client with which such a thread asks for the goals of others.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
from rclpy.node import Node
from rclpy.task import Future

from pianobot_ros.cell.host.priority import request_background

__all__ = ["JobClient", "OneJob", "background", "cancel"]

T = TypeVar("T")


def background(node: Node, work: Callable[[], T], name: str, *, low_priority: bool = True) -> Any:
    """A future of what ``work`` returns (or raises), done in a thread of its own, which leaves the
    processor to the others if it has ``low_priority``.
    """
    future: Future = Future(executor=node.executor)

    def run() -> None:
        if low_priority:
            request_background()
        try:
            future.set_result(work())
        except Exception as error:
            future.set_exception(error)
        if node.executor is not None:  # which does not watch this thread
            node.executor.wake()

    threading.Thread(target=run, name=name, daemon=True).start()
    return future


class OneJob:
    """Accepts a goal if none is being carried out. ``stopping`` is set when the node ends: the job
    must then end too.

    Args:
        node: whose goals these are.
        refusal: what to say of a goal that comes too early.
    """

    def __init__(self, node: Node, refusal: str) -> None:
        self._node, self._refusal = node, refusal
        self._lock = threading.Lock()
        self.busy = False
        self.stopping = threading.Event()

    def accepts(self, _: Any) -> GoalResponse:
        """Goal callback of an ActionServer; the node is busy from here to :meth:`done`."""
        with self._lock:
            if self.busy or self.stopping.is_set():
                self._node.get_logger().warning(f"goal rejected: {self._refusal}")
                return GoalResponse.REJECT
            self.busy = True
        return GoalResponse.ACCEPT

    def done(self) -> None:
        """The next goal may come."""
        self.busy = False

    def executes(
        self, work: Callable[[Any], tuple[str, Any]], *, low_priority: bool = True
    ) -> Callable[[Any], Awaitable[Any]]:
        """Execute callback of an ActionServer: ``work(goal)`` runs in a thread of its own and
        returns how the goal ended (``succeeded``, ``canceled``, ``aborted``) and the result."""

        def job(goal: Any) -> tuple[str, Any]:
            try:
                return work(goal)
            finally:
                self.done()  # here, as no coroutine runs once the executor has stopped

        async def execute(goal: Any) -> Any:
            finished = background(self._node, lambda: job(goal), "goal", low_priority=low_priority)
            await finished
            ended, result = finished.result()
            {"succeeded": goal.succeed, "canceled": goal.canceled, "aborted": goal.abort}[ended]()
            return result

        return execute

    def serve(
        self, kind: type, name: str, execute: Callable[[Any], Awaitable[Any]]
    ) -> ActionServer:
        """The node's server of the action ``name``, which may be cancelled at any time."""
        return ActionServer(
            self._node,
            kind,
            name,
            execute_callback=execute,
            goal_callback=self.accepts,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )

    def close(self, limit: float) -> None:
        """Ask the job to end and wait for it, at most ``limit`` s. Its executor need not spin for
        that.
        """
        self.stopping.set()
        end = time.monotonic() + limit
        while self.busy and time.monotonic() < end:
            time.sleep(0.01)


class JobClient(ActionClient):
    """An action client that other threads than the executor's may call.

    rclpy 7.1 sends a request and only then notes its number. An executor in another thread may have
    taken the answer by then, drops it ("Ignoring unexpected goal response"), and the future is
    never done. Here no answer is taken while a request is under way.
    """

    def __init__(self, node: Node, kind: type, name: str) -> None:
        self._sending = threading.RLock()
        super().__init__(node, kind, name)

    def send_goal_async(self, *args: Any, **options: Any) -> Any:
        """As rclpy's."""
        with self._sending:
            return super().send_goal_async(*args, **options)

    def _cancel_goal_async(self, goal_handle: Any) -> Any:
        with self._sending:
            return super()._cancel_goal_async(goal_handle)

    def _get_result_async(self, goal_handle: Any) -> Any:
        with self._sending:
            return super()._get_result_async(goal_handle)

    def take_data(self) -> Any:
        """What the executor takes, once the requests whose answers it may be are noted."""
        with self._sending:
            return super().take_data()


def cancel(sent: Any) -> None:
    """Cancel a goal that nobody waits for any more, once it is accepted: for the future of its
    acceptance (``add_done_callback``), which may still be on the way.
    """
    if not sent.cancelled() and sent.exception() is None and sent.result().accepted:
        sent.result().cancel_goal_async()
