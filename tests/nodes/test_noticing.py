"""Faults that nobody would notice by themselves: a device that falls silent or is not understood, a
second node or graph, a supervisor that stands still.
"""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path
from typing import Any

import cell_devices as cell
import pytest

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.host.claims import claim_name, current_domain, refuse_second

listed = pytest.mark.skipif(
    not os.access("/proc/net/unix", os.R_OK), reason="the kernel does not tell which names it gave"
)
SILENT, BACK, LOST = "the device sends none", "measures again", "link lost"
SUPERVISED = """
import sys, time
from pathlib import Path
from pianobot_ros.cli.graph.supervisor import Supervisor
from pianobot_ros.nodes.graph import NodeSpec
supervisor = Supervisor(Path(sys.argv[1]), print)
supervisor.start_nodes([NodeSpec("conductor", "playing")])
while True:
    supervisor.poll()
    time.sleep(0.05)
"""


@pytest.mark.graph
@pytest.mark.parametrize(
    ("device", "node"),
    [("fsr", "fsr_reader"), pytest.param("vacuum", "vacuum_regulator", marks=pytest.mark.long)],
)
def test_a_device_that_only_answers_is_named_once_and_so_is_its_return(
    ros: Any, processes: Any, tmp_path: Path, device: str, node: str
) -> None:
    port = tmp_path / "port"
    with cell.Device(device, tmp_path, "--link", str(port)) as emulated:
        processes.node(node, port=str(port))
        ros.wait_for(lambda: "active" in processes.output(node), "an active node")
        emulated.fault("silence")
        ros.wait_for(lambda: SILENT in processes.output(node), "silence in the log")
        emulated.fault("resume")
        ros.wait_for(lambda: BACK in processes.output(node), "the return in the log")
        said = processes.output(node)
    warnings = [line for line in said.splitlines() if "[WARN]" in line and SILENT in line]
    assert len(warnings) == 1 and str(port) in warnings[0]
    assert LOST not in said, "it answers, so the link is whole"


@pytest.mark.graph
def test_a_garbled_line_is_named_before_the_link_is_given_up(
    ros: Any, processes: Any, tmp_path: Path
) -> None:
    port = tmp_path / "port"
    with cell.Device("vacuum", tmp_path, "--link", str(port)) as emulated:
        processes.node("vacuum_regulator", port=str(port))
        ros.wait_for(lambda: "active" in processes.output("vacuum_regulator"), "an active node")
        emulated.fault("garble 1")
        ros.wait_for(lambda: LOST in processes.output("vacuum_regulator"), "the loss in the log")
    said = processes.output("vacuum_regulator")
    assert 0 < said.find("broken lines instead") < said.find(LOST)


@pytest.mark.graph
@listed
def test_a_second_conductor_refuses_and_the_next_one_may(ros: Any, processes: Any) -> None:
    first = processes.node("conductor", log="first")
    ros.wait_for(lambda: _taken("conductor"), "the first conductor")
    second = processes.node("conductor", log="second")
    assert second.wait(60.0) == 2
    (line,) = processes.output("second").splitlines()
    assert line.startswith("error: another conductor runs in ROS domain ")
    assert first.poll() is None
    first.send_signal(signal.SIGKILL)  # the middleware does not learn of that for a while
    first.wait()
    third = processes.node("conductor", log="third")
    ros.wait_for(lambda: _taken("conductor"), "the conductor that was started anew")
    assert third.end() == 0


@listed
def test_a_second_conductor_is_refused_before_it_loads_ros(
    ros: Any, processes: Any, tmp_path: Path
) -> None:
    words = (sys.executable, "-X", "importtime", "-m", "pianobot_ros.nodes.playing.conductor")
    with claim_name("conductor", current_domain()):
        assert processes.start(*words, log="second").wait(60.0) == 2
    said = processes.output("second")
    assert "error: another conductor runs in ROS domain " in said
    assert "pianobot_ros.cell" in said and "rclpy" not in said


@pytest.mark.graph
@pytest.mark.long
def test_a_second_recorder_may_listen_too(ros: Any, processes: Any, tmp_path: Path) -> None:
    for name in ("one", "two"):
        processes.node("recorder", log=name, output=str(tmp_path / name))
    for name in ("one", "two"):
        ros.wait_for(lambda name=name: (tmp_path / name).is_dir(), f"bag {name}")
    processes.wait_for(lambda: True)  # neither has ended


def test_a_second_graph_is_refused_before_anything_is_started(
    ros: Any, processes: Any, tmp_path: Path
) -> None:
    run = tmp_path / "run"
    with claim_name("graph", current_domain()):
        words = ("up", "--emulated", "--no-tui", "--run", str(run))
        assert processes.python("pianobot_ros.cli.app", *words, log="up").wait(60.0) == 2
    (line,) = processes.output("up").splitlines()
    assert line.startswith("error: another graph runs in ROS domain ")
    assert not run.exists()


@pytest.mark.graph
@listed
def test_a_supervisor_that_stands_still_is_named(ros: Any, processes: Any, tmp_path: Path) -> None:
    run = tmp_path / "run"
    process = processes.start(sys.executable, "-c", SUPERVISED, str(run), log="supervisor")
    log = run / "log" / "conductor.log"
    ros.wait_for(lambda: _taken("conductor"), "the conductor")
    process.send_signal(signal.SIGSTOP)
    ros.wait_for(lambda: "stands still" in log.read_text(), "the warning")
    process.send_signal(signal.SIGCONT)
    ros.wait_for(lambda: "goes on" in log.read_text(), "the all-clear")
    assert log.read_text().count("stands still") == 1


def _taken(name: str) -> bool:
    """Whether a process has the name in this test's domain. A look, not a claim: the process that
    is awaited would find the name taken for as long as the claim stands.
    """
    try:
        refuse_second(name, current_domain())
    except PianobotError:
        return True
    return False


@listed
def test_a_name_is_free_again_when_its_owner_is_gone() -> None:
    domain = 1000 + os.getpid()  # none of ROS
    first = claim_name("/cell/conductor", domain)
    with pytest.raises(PianobotError, match="another cell/conductor runs"):
        claim_name("/cell/conductor", domain)
    other = claim_name("/conductor", domain)
    first.close()
    claim_name("/cell/conductor", domain).close()
    other.close()
    refuse_second("conductor", domain)  # free, and a look takes nothing
    claim_name("conductor", domain).close()
    for name in ("conductor", "conductor2", "cell/conductor"):
        with claim_name(name, domain):
            for looked in ("conductor", "conductor2", "cell/conductor"):
                if looked == name:
                    with pytest.raises(PianobotError, match=f"another {name} runs in ROS domain"):
                        refuse_second(f"/{looked}", domain)
                else:
                    refuse_second(looked, domain)
                refuse_second(looked, domain + 1)
