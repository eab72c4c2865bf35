"""The diagnoser on a graph of its own: fed with a recording of the emulated cell as if it were
live.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np
import psutil
import pytest
from geometry_msgs.msg import Point, Pose, Quaternion
from pianobot_msgs.action import DiagnoseGap
from pianobot_msgs.msg import (
    Diagnosis,
    KeyAngle,
    KeyForce,
    MidiEvent,
    VacuumCommand,
    VacuumState,
    WristCommand,
    WristState,
)
from rclpy.action import ActionClient
from rclpy.serialization import serialize_message
from scipy.spatial.transform import Rotation

from pianobot_ros.bags.write import write_bag
from pianobot_ros.cell.motion.geometry import FINGERS
from pianobot_ros.cell.recordings.recording import Recording
from pianobot_ros.emulator.plant.offline import simulate_cell, standard_strikes
from pianobot_ros.nodes.analysis.gap_diagnoser import GapDiagnoser
from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.session.marks import mark_message

pytestmark = [pytest.mark.graph, pytest.mark.slow]


@pytest.fixture(scope="module")
def recording() -> Recording:
    commands = standard_strikes(3, 4, repeats=2)
    return simulate_cell(commands, effects={"wrist_delay": 8.0}, seed=3)


def feed(node: GapDiagnoser, recording: Recording) -> float:
    """Hand the node every message of the recording, stamped so that it has just ended; returns the
    last stamp.
    """
    last = max(s.end for s in recording.strikes)
    origin = time.time() - last - 1.0

    def stamped(kind: Any, t: float, **fields: Any) -> Any:
        message = kind(**fields)
        message.header.stamp = common.time_msg(round(1e9 * (origin + t)))
        return message

    def pose(name: str, i: int) -> Pose:
        x, y, z = recording.signals[f"{name}.position"].value[i].tolist()
        q = Rotation.from_rotvec(recording.signals[f"{name}.rotation"].value[i]).as_quat().tolist()
        return Pose(
            position=Point(x=x, y=y, z=z), orientation=Quaternion(x=q[0], y=q[1], z=q[2], w=q[3])
        )

    def send(name: str, messages: list[Any]) -> None:
        node._signals.feed(name, [serialize_message(m) for m in messages])

    for name, kind in (("command/wrist", WristCommand), ("real/wrist/state", WristState)):
        times = recording.signals[f"{name}.position"].time
        send(name, [stamped(kind, t, pose=pose(name, i)) for i, t in enumerate(times)])
    fingers = list(FINGERS)
    pressure = recording.signals["command/vacuum.pressure"]
    send(
        "command/vacuum",
        [
            stamped(VacuumCommand, t, fingers=fingers, pressure=p.tolist())
            for t, p in zip(pressure.time, pressure.value, strict=True)
        ],
    )
    setpoint, measured = (
        recording.signals[f"real/vacuum/state.{x}"] for x in ("setpoint", "measured")
    )
    send(
        "real/vacuum/state",
        [
            stamped(VacuumState, t, fingers=fingers, setpoint=a.tolist(), measured=b.tolist())
            for t, a, b in zip(setpoint.time, setpoint.value, measured.value, strict=True)
        ],
    )
    force, angle = recording.signals["real/fsr.force"], recording.signals["real/key_angle.64"]
    send(
        "real/fsr",
        [
            stamped(KeyForce, t, note=64, force=float(f))
            for t, f in zip(force.time, force.value, strict=True)
        ],
    )
    send(
        "real/key_angle",
        [
            stamped(KeyAngle, t, notes=[64], angle=[float(a)], velocity=[0.0])
            for t, a in zip(angle.time, angle.value, strict=True)
        ],
    )
    for n in recording.notes["real"]:
        status = MidiEvent.NOTE_ON if n.on else MidiEvent.NOTE_OFF
        node._signals.midi(
            stamped(MidiEvent, n.time, status=status, note=n.note, velocity=n.velocity)
        )
    for s in recording.strikes:
        node._signals.strike(mark_message(s, round(1e9 * origin)))
    return origin + last


def test_stage_map_then_diagnosis_of_what_was_seen_live(ros: Any, recording: Recording) -> None:
    node = ros.add(GapDiagnoser(context=ros.context))
    seen = ros.record(Diagnosis, "/gap/diagnosis")
    ros.matched(node._publisher)
    feed(node, recording)
    ros.wait_for(lambda: seen, "a stage map", 600.0)
    stages = {s.name: s.gap for s in seen[-1].stages}
    assert seen[-1].strikes == 4
    assert seen[-1].verdict == ""
    assert stages["wrist"] > 2.0 and stages["wrist"] == np.nanmax(list(stages.values()))

    client = ActionClient(ros.node("client"), DiagnoseGap, "/diagnose_gap")
    ros.wait_for(client.server_is_ready, "the server")
    feedback: list[Any] = []
    sent = client.send_goal_async(DiagnoseGap.Goal(), lambda m: feedback.append(m.feedback))
    goal = ros.wait_for(sent, what="the goal's acceptance")
    assert goal.accepted
    again = ros.wait_for(
        client.send_goal_async(DiagnoseGap.Goal()), what="an answer to the second goal"
    )
    assert not again.accepted
    answer = ros.wait_for(goal.get_result_async(), "a diagnosis", 600.0).result
    assert answer.success, answer.message
    assert answer.diagnosis.verdict in ("effect", "parameters", "unknown")
    assert answer.diagnosis.json and answer.diagnosis.strikes == 4
    # The answer may overtake what was told before it.
    ros.wait_for(lambda: any("screening" in f.stage for f in feedback), "the feedback")
    ros.wait_for(lambda: any(m.candidates and not m.verdict for m in seen), "who leads")
    assert [f.progress for f in feedback] == sorted(f.progress for f in feedback)
    leading = next(m for m in seen if m.candidates and not m.verdict)
    assert not leading.stages and "so far" in leading.sentence
    client.destroy()
    node.shut_down()


def test_the_worker_ends_with_a_node_that_was_killed(processes: Any) -> None:
    text = (
        "import threading, time\n"
        "from pianobot_ros.nodes.analysis.diagnosis_process import DiagnosisProcess\n"
        "process = DiagnosisProcess(threading.Event())\n"
        "process.start()\n"
        "print('worker', *process._pool._processes, flush=True)\n"
        "time.sleep(300)\n"
    )
    node = processes.start(sys.executable, "-c", text, log="node")
    processes.wait_for(lambda: node.output().endswith("\n"), "the worker", 120.0)
    worker = psutil.Process(int(node.output().split()[-1]))
    assert worker.is_running()
    node.kill()
    gone = (psutil.STATUS_ZOMBIE, psutil.STATUS_DEAD)
    processes.wait_for(
        lambda: not worker.is_running() or worker.status() in gone, "the worker's end"
    )


def test_no_strikes_and_no_such_bag_are_one_line(ros: Any, tmp_path: Any) -> None:
    node = ros.add(GapDiagnoser(context=ros.context))
    client = ActionClient(ros.node("client"), DiagnoseGap, "/diagnose_gap")
    ros.wait_for(client.server_is_ready, "the server")
    for request, words in (
        (DiagnoseGap.Goal(), "no strikes"),
        (DiagnoseGap.Goal(recording=str(tmp_path / "none")), "none"),
    ):
        goal = ros.wait_for(client.send_goal_async(request), what="acceptance")
        answer = ros.wait_for(goal.get_result_async(), "an answer", 600.0).result
        assert not answer.success
        assert words in answer.message and "\n" not in answer.message
    client.destroy()
    node.shut_down()


def test_cancel_ends_the_work_and_the_next_goal_is_accepted(
    ros: Any, recording: Recording, tmp_path: Any
) -> None:
    bag = write_bag(recording, tmp_path / "bag")
    node = ros.add(GapDiagnoser(context=ros.context))
    client = ActionClient(ros.node("client"), DiagnoseGap, "/diagnose_gap")
    ros.wait_for(client.server_is_ready, "the server")
    goal = ros.wait_for(
        client.send_goal_async(DiagnoseGap.Goal(recording=str(bag))), what="acceptance"
    )
    ros.wait_for(goal.cancel_goal_async(), what="the cancel's answer")
    answer = ros.wait_for(goal.get_result_async(), "the cancelled result").result
    assert answer.message == "cancelled"
    second = ros.wait_for(
        client.send_goal_async(DiagnoseGap.Goal()), what="acceptance after a cancel"
    )
    assert second.accepted
    ros.wait_for(second.get_result_async(), timeout=600.0)
    client.destroy()
    node.shut_down()
