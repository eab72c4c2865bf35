"""The node ``vacuum_regulator`` as a process of its own, against the emulated regulator."""

from __future__ import annotations

import math
import signal
from pathlib import Path
from typing import Any

import cell_devices as cell
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from pianobot_msgs.msg import VacuumCommand, VacuumState, WristState

from pianobot_ros.nodes.base import common
from pianobot_ros.testing import TIMEOUT

pytestmark = pytest.mark.graph
NODE = "pianobot_ros.nodes.devices.vacuum_regulator"


def command(
    ros: Any, fingers: list[str], pressure: list[float], age: float | None = None
) -> VacuumCommand:
    message = VacuumCommand(fingers=fingers, pressure=pressure)
    if age is not None:  # without a stamp a command is never stale
        now = ros.nodes[0].get_clock().now().nanoseconds
        message.header.stamp = common.time_msg(now - round(age * 1e9))
    return message


def levels(reports: list[Any]) -> list[int]:
    return [
        ord(s.level) for a in reports for s in a.status if s.name.startswith("vacuum_regulator")
    ]


def test_obeys_refuses_reconnects_and_vents(ros: Any, processes: Any, tmp_path: Path) -> None:
    node = ros.node("tester")
    states = ros.record(VacuumState, "/real/vacuum/state")
    reports = ros.record(DiagnosticArray, "/diagnostics")
    refused = ros.record(DiagnosticArray, "/real/refusals")
    publisher = node.create_publisher(VacuumCommand, "/command/vacuum", common.COMMAND_QOS)
    wrist = node.create_publisher(WristState, "/real/wrist/state", common.SENSOR_QOS)
    # The node comes first, and waits for its device.
    process = processes.python(
        NODE,
        "--ros-args",
        "-p",
        f"port:={tmp_path / 'port'}",
        "-p",
        "retry_period:=0.2",
        log="node",
    )
    ros.wait_for(
        lambda: "no vacuum regulator at" in processes.output("node"), "missing device reported"
    )
    with cell.Device("vacuum", tmp_path, "--link", str(tmp_path / "port")) as device:
        ros.wait_for(lambda: len(states) > 3 and publisher.get_subscription_count(), "states")
        # Said again and again: one that has come late, or while the device hung, is refused.
        three = ["thumb", "index", "middle"]
        ros.wait_for(
            lambda: (
                publisher.publish(command(ros, three, [-1e4, -2e4, -3e4], age=0.0))
                or list(states[-1].setpoint) == [-1e4, -2e4, -3e4]
            ),
            "setpoint obeyed",
        )
        assert list(states[-1].fingers) == three
        ros.wait_for(
            lambda: (
                publisher.publish(command(ros, ["index"], [-4e5]))
                or list(states[-1].setpoint) == [-1e4, -1e5, -3e4]
            ),
            "one finger, clipped, the others stay",
        )
        ros.wait_for(
            lambda: any("clamped" in s.message for array in refused for s in array.status),
            "the clipping told",
        )
        foreign = command(ros, ["index"], [-5e4])
        foreign.header.frame_id = "tool0"
        for bad, text in (
            (command(ros, ["indx"], [-1e4]), "did you mean 'index'"),
            (command(ros, ["index"], [math.nan]), "finite"),
            (command(ros, ["index"], []), "one pressure to each"),
            (command(ros, ["index"], [-5e4], age=3.0), "old"),
            (command(ros, ["index"], [-5e4], age=-60.0), "ahead"),
            (foreign, "in the frame 'tool0'"),
        ):
            ros.wait_for(
                lambda text=text, bad=bad: (
                    publisher.publish(bad) or text in processes.output("node")
                ),
                text,
            )
        assert list(states[-1].setpoint) == [-1e4, -1e5, -3e4]
        reports.clear()  # the first ones were of a device that was not there yet
        device.fault("unplug")
        ros.wait_for(lambda: 2 in levels(reports), "unplugged in /diagnostics")
        device.fault("replug")
        count = len(states)
        ros.wait_for(
            lambda: len(states) > count + 5 and list(states[-1].setpoint) == [-1e4, -1e5, -3e4],
            "back as before",
        )
        reports.clear()
        ros.wait_for(lambda: 0 in levels(reports), "well again in /diagnostics")
        stop = WristState(safety_state=WristState.SAFETY_EMERGENCY_STOP)
        ros.wait_for(
            lambda: wrist.publish(stop) or list(states[-1].setpoint) == [0.0, 0.0, 0.0],
            "vented at emergency stop",
        )
        well = WristState(safety_state=WristState.SAFETY_NORMAL)
        ros.wait_for(
            lambda: (
                wrist.publish(well)
                or publisher.publish(command(ros, ["thumb"], [-7e4]))
                or states[-1].setpoint[0] == -7e4
            ),
            "obeys again",
        )
        assert process.end(signal.SIGINT) == 0
        # The line that says so may still be on its way to the device.
        ros.wait_for(lambda: device.status()["setpoint"] == [0, 0, 0], "vented")


def test_bad_parameters_end_it_with_one_line(processes: Any, ros_domain: int) -> None:
    for parameter, text in (("lowest:=1.0", "must be in"), ("prt:=x", "did you mean 'port'")):
        process = processes.python(NODE, "--ros-args", "-p", parameter, log=parameter[:3])
        assert process.wait(TIMEOUT) == 2
        assert text in processes.output(parameter[:3])


def test_the_wrong_device_is_named(ros: Any, processes: Any, tmp_path: Path) -> None:
    says = "this is the FSR reader, not the vacuum regulator"
    cell.expect_refused(ros, processes, NODE, tmp_path, "fsr", says)
