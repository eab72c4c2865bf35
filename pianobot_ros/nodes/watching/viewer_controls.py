"""What the page's buttons do: the graph's own actions and services, with their own refusals."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from action_msgs.srv import CancelGoal
from pianobot_msgs.action import DiagnoseGap, Investigate, PlayPhrase
from pianobot_msgs.srv import Adopt
from rclpy.node import Node
from std_srvs.srv import Trigger

from pianobot_ros.cell.score.load import phrase_names
from pianobot_ros.nodes.base.jobs import JobClient
from pianobot_ros.piano.view.controls import ControlPanel

__all__ = ["Controls"]

ANSWER = 10.0  # s in which a node must answer
LONG = 7200.0  # s that a job may take
Tell = Callable[[str], None]


class Controls:
    """The panel, and the clients behind it. ``output`` is where reports of diagnoses go."""

    def __init__(self, node: Node, gui: Any, output: Path) -> None:
        self._node, self._output = node, output
        self._actions = {
            kind: JobClient(node, kind, name)
            for kind, name in (
                (PlayPhrase, "/play_phrase"),
                (DiagnoseGap, "/diagnose_gap"),
                (Investigate, "/investigate"),
            )
        }
        self._cancel = [
            node.create_client(CancelGoal, f"/{name}/_action/cancel_goal")
            for name in ("play_phrase", "diagnose_gap", "investigate")
        ]
        self._adopt = node.create_client(Adopt, "/sim_twin/adopt")
        self._forget = node.create_client(Trigger, "/sim_twin/forget")
        self.panel = ControlPanel(
            gui,
            phrase_names(),
            {
                "play": self._play,
                "stop": self._stop,
                "diagnose": self._diagnose,
                "investigate": self._investigate,
                "adopt": lambda _, __: self._adopted(),
                "forget": lambda _, __: self._call(self._forget, Trigger.Request()),
            },
        )

    def ready(self) -> bool:
        """Whether the graph offers everything that the buttons call."""
        services = (*self._cancel, self._adopt, self._forget)
        return all(c.server_is_ready() for c in self._actions.values()) and all(
            c.service_is_ready() for c in services
        )

    def _play(self, phrase: str, tell: Tell) -> str:
        def shown(feedback: Any) -> None:
            tell(f"strike {feedback.strike} of {feedback.total}")

        return self._run(PlayPhrase, PlayPhrase.Goal(score=phrase), shown)

    def _diagnose(self, _: str, tell: Tell) -> str:
        def shown(feedback: Any) -> None:
            tell(f"{feedback.stage}: {100 * feedback.progress:.0f} %")

        return self._run(DiagnoseGap, DiagnoseGap.Goal(output=str(self._output)), shown)

    def _investigate(self, phrase: str, tell: Tell) -> str:
        def shown(feedback: Any) -> None:
            tell(f"{feedback.doing}: {feedback.strikes} of {feedback.budget} strikes")

        goal = Investigate.Goal(score=phrase, output=str(self._output))
        return self._run(Investigate, goal, shown)

    def _stop(self, _: str, __: Tell) -> str:
        asked = 0
        for client in self._cancel:
            if client.service_is_ready():
                client.call_async(CancelGoal.Request())  # all zero: every goal
                asked += 1
        return "asked every job to end" if asked else "no job listens"

    def _adopted(self) -> str:
        document = self._output / "diagnosis.json"
        if not document.exists():
            return "diagnose first: nothing was found that could be adopted"
        return self._call(self._adopt, Adopt.Request(corrections=str(document)))

    def _run(self, kind: Any, goal: Any, shown: Callable[[Any], None]) -> str:
        client = self._actions[kind]
        if not client.server_is_ready():
            return "not offered by this graph"
        handle = self._wait(
            client.send_goal_async(goal, lambda message: shown(message.feedback)), ANSWER
        )
        if not handle.accepted:
            return "refused: it is busy"
        return str(self._wait(handle.get_result_async(), LONG).result.message)

    def _call(self, client: Any, request: Any) -> str:
        if not client.service_is_ready():
            return "not offered by this graph"
        return str(self._wait(client.call_async(request), ANSWER).message)

    @staticmethod
    def _wait(future: Any, timeout: float) -> Any:
        """What a future gives that the node's executor completes."""
        done = threading.Event()
        future.add_done_callback(lambda _: done.set())
        if not done.wait(timeout):
            raise TimeoutError(f"no answer in {timeout:g} s")
        return future.result()

    def close(self) -> None:
        """Destroy the clients."""
        for client in self._actions.values():
            client.destroy()
