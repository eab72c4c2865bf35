"""What the command line sees of a running graph: node states, strikes compared, the twin's pace;
and a client for phrases.
"""

from __future__ import annotations

import os
import signal
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from pianobot_msgs.action import PlayPhrase
from pianobot_msgs.msg import GapReport, TwinStatus
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger

from pianobot_ros.cell.host.way_out import way_out
from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.base.discovery import discovery

__all__ = ["Observer", "leave"]

LEVELS = {0: "ok", 1: "warning", 2: "error", 3: "stale"}
SILENT = 3.0  # s without diagnostics after which a node counts as silent


class Observer:
    """A node in the process of the command line; call :meth:`spin` often.

    ``executor`` is that of a caller who has a context already and spins it.
    """

    def __init__(self, name: str = "pianobot_cli", executor: Any = None) -> None:
        import rclpy

        self._guest = executor is not None
        if not self._guest:
            os.environ.update(discovery())
            context = Context()
            rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
            executor = SingleThreadedExecutor(context=context)
        self._executor, self._context = executor, executor.context
        self.node = Node(name, context=self._context)
        self._executor.add_node(self.node)
        self.reports: list[GapReport] = []
        self.twin: TwinStatus | None = None
        self._states: dict[str, tuple[float, int, str, str]] = {}
        self.values: dict[str, dict[str, str]] = {}
        """What each node's diagnostics said last, in numbers and words."""
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 50)
        self.node.create_subscription(GapReport, "/gap/live", self.reports.append, common.EVENT_QOS)
        self.node.create_subscription(TwinStatus, "/sim/status", self._on_twin, common.SENSOR_QOS)
        self._play = ActionClient(self.node, PlayPhrase, "/play_phrase")
        self._recover = self.node.create_client(Trigger, "/ur5_wrist/recover")

    def _on_twin(self, message: TwinStatus) -> None:
        self.twin = message

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        for status in array.status:
            node, _, part = status.name.partition(": ")
            level = int.from_bytes(status.level, "little")
            self.values[node] = {pair.key: pair.value for pair in status.values}
            self._states[f"{node}: {part}"] = (time.monotonic(), level, status.message, node)

    def states(self) -> dict[str, tuple[str, str]]:
        """Worst state and its message by node."""
        worst: dict[str, tuple[int, str]] = {}
        now = time.monotonic()
        for seen, level, message, node in self._states.values():
            entry = (3, "silent") if now - seen > SILENT else (level, message)
            if node not in worst or entry[0] > worst[node][0]:
                worst[node] = entry
        return {node: (LEVELS.get(level, "?"), message) for node, (level, message) in worst.items()}

    def spin(self, timeout: float) -> None:
        """Let messages in for ``timeout`` s."""
        end = time.monotonic() + timeout
        while (left := end - time.monotonic()) > 0:
            self._executor.spin_once(timeout_sec=left)

    def conductor_ready(self) -> bool:
        """Whether phrases can be sent."""
        return bool(self._play.server_is_ready())

    def conductors(self) -> set[bytes]:
        """Who offers to play phrases, by names that the middleware gives anew to each process: one
        that was killed is listed until its lease of 20 s is over.
        """
        # The one topic of an action that its server alone publishes.
        ends = self.node.get_publishers_info_by_topic("/play_phrase/_action/status")
        return {bytes(end.endpoint_gid) for end in ends}

    def recover_arm(self) -> bool:
        """Ask the arm to recover, without waiting for the answer; False if nobody listens yet."""
        if not self._recover.service_is_ready():
            return False
        self._recover.call_async(Trigger.Request())
        return True

    def send(self, goal: PlayPhrase.Goal, feedback: Any = None) -> Any:
        """Send a phrase; returns the future of its acceptance."""
        return self._play.send_goal_async(goal, feedback)

    def close(self) -> None:
        """Listen no more. A guest leaves the graph; else the process does at its end, by
        :func:`leave`: the middleware may hold it up, and what it has to say comes first.
        """
        self._executor.remove_node(self.node)
        if self._guest:
            self._destroy()
        else:
            _CLOSED.append(self)

    def _destroy(self) -> None:
        import rclpy

        if not self._guest:
            self._executor.shutdown(timeout_sec=0.5)
        self._play.destroy()
        self.node.destroy_node()
        if not self._guest:
            rclpy.try_shutdown(context=self._context)


_CLOSED: list[Observer] = []


def leave(code: int) -> None:
    """Leave the graph, the last thing that a process does; if the middleware holds it up, it ends
    with ``code``. A further Ctrl-C changes nothing.
    """
    if not _CLOSED:
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with way_out(code):
            while _CLOSED:
                _CLOSED.pop()._destroy()
    finally:
        signal.signal(signal.SIGINT, before)
