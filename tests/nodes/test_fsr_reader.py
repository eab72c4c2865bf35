"""The node ``fsr_reader`` as a process of its own, against the emulated reader, and the peak
follower.
"""

from __future__ import annotations

import math
import signal
from pathlib import Path
from typing import Any

import cell_devices as cell
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from hypothesis import given
from hypothesis import strategies as st
from pianobot_msgs.msg import KeyAngle, KeyForce

from pianobot_ros.devices.fsr import FsrReading
from pianobot_ros.nodes.devices.fsr_reader import PeakFollower
from pianobot_ros.testing import TIMEOUT

NODE = "pianobot_ros.nodes.devices.fsr_reader"


@given(st.lists(st.floats(0.2, 20.0), min_size=1, max_size=200))
def test_each_press_ends_with_its_true_peak(forces: list[float]) -> None:
    follower = PeakFollower(0.15, 0.01)
    found = []
    for i, force in enumerate([*forces, 0.0]):
        at = 2_000_000 * i
        if (peak := follower.feed(FsrReading(at, at, i, 0, force, False, None))) is not None:
            found.append(peak.force)
    assert found[-1] == max(forces)
    assert found == sorted(found)
    assert len(found) <= len(forces) // 5 + 10 or len(found) < len(forces)


@pytest.mark.graph
def test_streams_survives_faults_and_ends(ros: Any, processes: Any, tmp_path: Path) -> None:
    ros.node("tester")
    forces = ros.record(KeyForce, "/real/fsr")
    peaks = ros.record(KeyForce, "/real/fsr/peak")
    angles = ros.record(KeyAngle, "/real/key_angle")
    reports = ros.record(DiagnosticArray, "/diagnostics")
    arguments = ["-p", f"port:={tmp_path / 'port'}", "-p", "rate:=200"]
    with cell.Device("fsr", tmp_path, "--link", str(tmp_path / "port")) as device:
        process = processes.python(NODE, "--ros-args", *arguments, log="node")
        ros.wait_for(lambda: len(forces) > 200 and len(peaks) > 2 and len(angles) > 200, "samples")
        # A machine that is held up may miss the middle of a press: there is another one.
        steepest = 0.04 * math.pi / 0.2
        ros.wait_for(
            lambda: (
                min(max(m.force for m in one) for one in (forces, peaks)) > 4.95
                and max(m.angle[0] for m in angles) > 0.039
                and max(m.velocity[0] for m in angles) > 0.9 * steepest
            ),
            "the middle of a press",
        )
        assert {m.note for m in forces} == {64} and max(m.force for m in forces) == pytest.approx(
            5.0, abs=0.05
        )
        assert max(m.counts for m in forces) == pytest.approx(1022, abs=25)
        assert max(m.force for m in peaks) == pytest.approx(5.0, abs=0.05)
        assert list(angles[-1].notes) == [64]
        assert max(m.angle[0] for m in angles) == pytest.approx(0.04, abs=1e-3)
        # A half sine of 0.04 rad in 0.2 s; the slope over 10 ms is a little less than the steepest.
        assert max(m.velocity[0] for m in angles) == pytest.approx(steepest, rel=0.1)
        device.fault("garble 0.2")
        ros.wait_for(
            lambda: any(
                v.key == "bad_lines" and int(v.value) > 5
                for a in reports
                for s in a.status
                for v in s.values
            ),
            "garbled lines in /diagnostics",
        )
        device.fault("garble 0")
        reports.clear()
        device.fault("unplug")
        ros.wait_for(
            lambda: any(s.level == b"\x02" for a in reports for s in a.status),
            "loss in /diagnostics",
        )
        device.fault("replug")
        count = len(forces)
        ros.wait_for(lambda: len(forces) > count + 50, "samples again")
        assert process.end(signal.SIGTERM) == 0


@pytest.mark.graph
def test_a_wrong_device_and_a_wrong_clock_are_named(
    ros: Any, processes: Any, tmp_path: Path
) -> None:
    bad = processes.python(NODE, "--ros-args", "-p", "clock:=trackd", log="bad")
    assert bad.wait(TIMEOUT) == 2 and "did you mean 'tracked'" in processes.output("bad")
    says = "this is the vacuum regulator, not the FSR reader"
    cell.expect_refused(ros, processes, NODE, tmp_path, "vacuum", says)
