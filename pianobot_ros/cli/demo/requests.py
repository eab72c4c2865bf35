"""What the demo asks of the running graph, as any user of it would: its services and its action
DiagnoseGap.
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

from pianobot_ros.cell.errors import PianobotError

__all__ = ["adopt", "begin_bag", "diagnose", "end_bag", "forget"]

ANSWER = 20.0  # s in which a node must answer
TELL_PROGRESS = 20.0  # s between two lines about a diagnosis, where there is no screen
LONGEST = 1200.0  # s that a diagnosis may take on a busy machine


def adopt(cell: Any, corrections: str) -> None:
    """Let the twin of the running ``cell`` adopt an overlay: its path or its text."""
    from pianobot_msgs.srv import Adopt

    request = Adopt.Request(corrections=corrections)
    _must(_call(cell, Adopt, "/sim_twin/adopt", request), "the twin")


def forget(cell: Any) -> None:
    """Let the twin of the running ``cell`` forget what it has adopted."""
    from std_srvs.srv import Trigger

    _must(_call(cell, Trigger, "/sim_twin/forget", Trigger.Request()), "the twin")


def end_bag(cell: Any) -> None:
    """Let the recorder end its bag; where it has ended by itself, the bag says so."""
    from std_srvs.srv import Trigger

    _call(cell, Trigger, "/recorder/stop", Trigger.Request())


def begin_bag(cell: Any) -> None:
    """Let the recorder begin the next bag, beside the last one."""
    from std_srvs.srv import Trigger

    _must(_call(cell, Trigger, "/recorder/start", Trigger.Request()), "the recorder")


def diagnose(cell: Any, bag: Path, output: Path) -> dict[str, Any]:
    """Let ``gap_diagnoser`` diagnose a bag, with the report in ``output``; diagnosis.json. Whoever
    watches the graph sees its progress, who leads, and the verdict.
    """
    from pianobot_msgs.action import DiagnoseGap
    from rclpy.action import ActionClient

    told = time.monotonic()

    def shown(message: Any) -> None:
        nonlocal told
        f = message.feedback
        cell.note = f"diagnosis: {f.stage}, {100 * f.progress:.0f} %"
        if not cell.on_screen and time.monotonic() - told > TELL_PROGRESS:
            told = time.monotonic()
            cell.tell(cell.note)

    client = ActionClient(cell.observer.node, DiagnoseGap, "/diagnose_gap")
    try:
        silent = "nobody diagnoses in this graph"
        cell.wait(client.server_is_ready, ANSWER, lambda: silent)
        goal = DiagnoseGap.Goal(recording=str(bag), output=str(output))
        sent = client.send_goal_async(goal, shown)
        cell.wait(sent.done, ANSWER, lambda: silent)
        if not sent.result().accepted:
            raise PianobotError("a diagnosis is running already: cancel it first")
        answer = sent.result().get_result_async()
        cell.wait(answer.done, LONGEST, lambda: "the diagnosis did not end in time")
    finally:
        client.destroy()
        cell.note = ""
    result = answer.result().result
    if not result.success:
        raise PianobotError(result.message)
    found: dict[str, Any] = json.loads(result.diagnosis.json)
    return found


def _call(cell: Any, kind: Any, service: str, request: Any) -> Any:
    """The answer of a service."""
    client = cell.observer.node.create_client(kind, service)
    name = service.split("/")[1]
    cell.wait(client.service_is_ready, ANSWER, lambda: f"{name} does not answer")
    answer = client.call_async(request)
    cell.wait(answer.done, ANSWER, lambda: f"{name} does not answer")
    cell.observer.node.destroy_client(client)
    return answer.result()


def _must(outcome: Any, who: str) -> None:
    if not outcome.success:
        raise PianobotError(f"{who} refused: {outcome.message}")
