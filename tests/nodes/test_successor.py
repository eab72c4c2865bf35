"""What a node was told since its start outlasts a process that dies, and no orderly end."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any

import pytest

from pianobot_ros.cell.host.marks import Legacy

pytestmark = pytest.mark.graph


def legacy(*command: str) -> Legacy:
    made = Legacy()
    made.inherit([str(os.getpid()), *command])
    return made


def insist(ros: Any, kind: Any, name: str, request: Any) -> Any:
    """The first answer of a service, which is asked anew each second: for a while a request may go
    to the dead.
    """
    client = ros.tester.create_client(kind, name)
    asked: list[Any] = []
    due = 0.0

    def answered() -> Any:
        nonlocal due
        if time.monotonic() > due and client.service_is_ready():
            asked.append(client.call_async(request))
            due = time.monotonic() + 1.0
        return next((future.result() for future in asked if future.done()), None)

    return ros.wait_for(answered, f"an answer of {name}")


def test_a_legacy_is_of_one_command_and_of_who_owned_it() -> None:
    first = legacy("node", "-p", "speed:=1")
    first.own()
    first.keep("speed", 0.5)
    # one that is refused, since the first lives: it reads, and neither writes nor takes away
    second = legacy("node", "-p", "speed:=1")
    second.keep("speed", 0.7)
    second.close()
    assert legacy("node", "-p", "speed:=2").get("speed") is None
    successor = legacy("node", "-p", "speed:=1")
    assert successor.get("speed") == 0.5
    successor.own()
    successor.close()
    assert legacy("node", "-p", "speed:=1").get("speed") is None


def test_what_somebody_else_laid_there_is_no_legacy(tmp_path: Path) -> None:
    first = legacy("a node", "of mine")
    first.own()
    first.keep("speed", 0.5)
    path = first._path
    assert path is not None
    moved = tmp_path / "laid"
    moved.write_bytes(path.read_bytes())
    path.unlink()
    try:
        path.symlink_to(moved)
        assert legacy("a node", "of mine").get("speed") is None
        first.keep("speed", 0.6)  # takes the place of the link, and follows none
        assert "0.6" not in moved.read_text(encoding="utf-8")
        assert legacy("a node", "of mine").get("speed") == 0.6
        if os.getuid() == 0:
            os.chown(path, 65534, -1)
            assert legacy("a node", "of mine").get("speed") is None
    finally:
        first.close()
    assert not path.exists()


def test_a_parameter_outlasts_a_node_that_is_killed(ros: Any, processes: Any) -> None:
    from rcl_interfaces.srv import GetParameters, SetParameters
    from rclpy.parameter import Parameter

    def transposed() -> int:
        asked = GetParameters.Request(names=["transpose"])
        answer = insist(ros, GetParameters, "/conductor/get_parameters", asked)
        return int(answer.values[0].integer_value)

    node = processes.node("conductor", transpose=3)
    for end, after in ((signal.SIGKILL, 5), (signal.SIGTERM, 3)):
        five = Parameter("transpose", value=5).to_parameter_msg()
        request = SetParameters.Request(parameters=[five])
        answer = insist(ros, SetParameters, "/conductor/set_parameters", request)
        assert answer.results[0].successful
        node.end(end)
        node = processes.node("conductor", transpose=3)
        assert transposed() == after
        assert ("transpose = 5" in node.output()) == (end == signal.SIGKILL)


def test_the_twin_keeps_what_it_adopted_and_what_it_forgot(
    ros: Any, processes: Any, tmp_path: Path
) -> None:
    from pianobot_msgs.msg import TwinStatus
    from pianobot_msgs.srv import Adopt
    from std_srvs.srv import Trigger

    from pianobot_ros.piano.gap.adoption.live_laws import parse_effects

    status = ros.record(TwinStatus, "/sim/status")

    def started(end: int = 0, node: Any = None) -> Any:
        if node is not None:
            node.end(end)
        status.clear()
        node = processes.node("sim_twin", status_rate=10.0, corrections=str(file))
        ros.wait_for(lambda: bool(status), "a twin")
        return node

    def adopted() -> list[str]:
        status.clear()
        ros.wait_for(lambda: bool(status), "its status")
        return list(status[-1].adopted)

    text = parse_effects(["midi_latency.midi_latency=0.01"])
    other = parse_effects(["pressure_lag.pressure_lag=0.1"])
    file = tmp_path / "corrections.yaml"
    file.write_text(text.to_yaml(), encoding="utf-8")
    node = started()
    assert adopted() == text.names()
    assert insist(ros, Trigger, "/sim_twin/forget", Trigger.Request()).success
    node = started(signal.SIGKILL, node)
    assert adopted() == []
    request = Adopt.Request(corrections=other.to_yaml())
    assert insist(ros, Adopt, "/sim_twin/adopt", request).success
    node = started(signal.SIGKILL, node)
    assert adopted() == other.names()
    assert other.names()[0] in node.output()
    started(signal.SIGTERM, node)
    assert adopted() == text.names()
