"""The node ``midi_bridge`` as a process of its own, against the emulated piano."""

from __future__ import annotations

import math
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cell_devices as cell
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from pianobot_msgs.msg import KeyForce, Keystroke, MidiEvent, StrikeMark

from pianobot_ros.nodes.base import common

pytestmark = pytest.mark.graph
NODE = "pianobot_ros.nodes.devices.midi_bridge"


@pytest.fixture
def address() -> str:
    return cell.free_address()


@pytest.fixture
def piano(address: str, tmp_path: Path) -> Iterator[cell.Device]:
    # Without active sensing: what silences it after a kill is the bridge's guard.
    arguments = ("--transport", "socket", "--socket", address, "--signal", "0.4", "--no-sensing")
    with cell.Device("midi", tmp_path, *arguments) as process:
        yield process


def start(processes: Any, address: str) -> Any:
    parameters = ["-p", "transport:=socket", "-p", f"socket:={address}", "-p", "retry_period:=0.2"]
    return processes.python(NODE, "--ros-args", *parameters, log="node")


def test_notes_and_keystrokes_with_idle_time_and_force(
    ros: Any, processes: Any, piano: cell.Device, address: str
) -> None:
    node = ros.node("tester")
    events = ros.record(MidiEvent, "/real/midi")
    strokes = ros.record(Keystroke, "/real/keystroke")
    marks = node.create_publisher(StrikeMark, "/command/strike", common.EVENT_QOS)
    peaks = node.create_publisher(KeyForce, "/real/fsr/peak", common.EVENT_QOS)
    process = start(processes, address)
    ros.matched(marks, peaks)

    def whole() -> list[Keystroke]:
        """Those that the piano played as it should, without being held up."""
        return [s for s in strokes if s.t_hold == pytest.approx(0.2, abs=0.1)]

    ros.wait_for(whole, "strokes")
    assert "MIDI over socket" in processes.output("node")
    first = whole()[0]
    # between topics there is no order, and one may be heard before the other
    ros.wait_for(lambda: any(events_of(s, events) for s in strokes), "a stroke's events")
    assert {s.v_pre for s in strokes} == {first.v_pre}
    assert (first.note, first.velocity_pre, first.velocity_rel) == (64, 75, 40)
    assert first.v_pre == pytest.approx(0.276, abs=0.002)
    assert math.isnan(first.t_idle) and math.isnan(first.peak_force)
    now = node.get_clock().now().nanoseconds
    mark = StrikeMark(note=64, note_length=0.5, end=common.time_msg(now + 10**11))
    mark.header.stamp = common.time_msg(now)
    marks.publish(mark)
    sounding = [False]

    def pressed() -> bool:
        """A force peak right after each note-on."""
        down = bool(events) and events[-1].status == MidiEvent.NOTE_ON
        if down and not sounding[0]:
            peak = KeyForce(note=64, force=3.5)
            peak.header.stamp = events[-1].header.stamp
            peaks.publish(peak)
        sounding[0] = down
        return any(s.peak_force == 3.5 and not math.isnan(s.t_idle) for s in strokes)

    ros.wait_for(pressed, "keystroke with idle time and force")
    full = next(s for s in strokes if s.peak_force == 3.5 and not math.isnan(s.t_idle))
    assert full.t_hold + full.t_idle == pytest.approx(0.5, abs=1e-9)
    assert process.end(signal.SIGINT) == 0


def events_of(stroke: Keystroke, events: list[MidiEvent]) -> bool:
    """Whether its two events are among those heard, as far apart as it was held."""
    stamps = {(e.header.stamp.sec, e.header.stamp.nanosec): e.status for e in events}
    on, off = stroke.onset, stroke.header.stamp
    held = off.sec - on.sec + 1e-9 * (off.nanosec - on.nanosec)
    assert stroke.t_hold == pytest.approx(held, abs=1e-8)
    return (
        stamps.get((on.sec, on.nanosec)) == MidiEvent.NOTE_ON
        and stamps.get((off.sec, off.nanosec)) == MidiEvent.NOTE_OFF
    )


@pytest.mark.parametrize(
    "number", [pytest.param(signal.SIGINT, marks=pytest.mark.long), signal.SIGKILL]
)
def test_the_twin_sounds_and_nothing_hangs(
    ros: Any, processes: Any, piano: cell.Device, address: str, number: int
) -> None:
    node = ros.node("tester")
    twin = node.create_publisher(MidiEvent, "/sim/midi", common.EVENT_QOS)
    process = start(processes, address)
    ros.matched(twin)
    for note in (60, 67):
        twin.publish(MidiEvent(status=MidiEvent.NOTE_ON, note=note, velocity=70))
    ros.wait_for(
        lambda: piano.status()["sounding"] == {"1": [60, 67]}, "notes sound on the twin's channel"
    )
    twin.publish(MidiEvent(status=MidiEvent.NOTE_OFF, note=60))
    ros.wait_for(lambda: piano.status()["sounding"] == {"1": [67]}, "one released")
    process.end(number)
    cell.until(lambda: piano.status()["sounding"] == {}, "nothing hangs")


def test_a_piano_that_is_switched_off_while_it_sounds_says_so(
    ros: Any, processes: Any, piano: cell.Device, address: str
) -> None:
    twin = ros.publisher(MidiEvent, "/sim/midi", common.EVENT_QOS)
    start(processes, address)
    ros.matched(twin)
    twin.publish(MidiEvent(status=MidiEvent.NOTE_ON, note=60, velocity=70))
    ros.wait_for(lambda: piano.status()["sounding"] == {"1": [60]}, "the note sounds")
    piano.process.terminate()
    piano.process.wait()
    assert "while notes sounded: {'1': [60]}" in piano.said()


def test_the_piano_may_come_later_go_and_come_back(
    ros: Any, processes: Any, address: str, tmp_path: Path
) -> None:
    ros.node("tester")
    events = ros.record(MidiEvent, "/real/midi")
    reports = ros.record(DiagnosticArray, "/diagnostics")
    start(processes, address)
    ros.wait_for(
        lambda: "no piano listens at" in processes.output("node"), "missing piano reported"
    )
    arguments = ("--transport", "socket", "--socket", address, "--signal", "0.2")

    def well() -> bool:
        return bool(reports) and all(s.level == b"\x00" for s in reports[-1].status)

    for _ in range(2):
        count = len(events)
        with cell.Device("midi", tmp_path, *arguments) as device:
            ros.wait_for(lambda count=count: len(events) > count + 2, "events")
            ros.wait_for(well, "word of the piano that is there")
            reports.clear()  # the earlier ones were of one that was not
            device.process.kill()
            ros.wait_for(
                lambda: any(s.level == b"\x02" for a in reports for s in a.status), "death reported"
            )
