"""The whole cell as a user runs it: ``pianobot up --emulated`` plays, compares, records, survives
kills and leaves nothing.

One graph for the module; its tests build on one another, in the order of the file.
"""

from __future__ import annotations

import contextlib
import signal
import socket
from collections.abc import Iterator
from typing import Any

import numpy as np
import psutil
import pytest
from pianobot_msgs.msg import StrikeMark
from rosbags.highlevel import AnyReader

from pianobot_ros.bags.raw_messages import read_raw
from pianobot_ros.bags.reading.read import read_bag
from pianobot_ros.bags.repair import is_whole
from pianobot_ros.cell.host.halted import living
from pianobot_ros.cell.recordings.recording import Recording
from pianobot_ros.piano.gap.evidence.time_stamps import is_live
from pianobot_ros.piano.gap.simulation.piano_twin import PianoTwin
from pianobot_ros.testing import RunningCell, wait_for

pytestmark = [pytest.mark.graph, pytest.mark.slow]

PHRASE = """
strikes:
  - {note: 64, speed: 0.15, depth: 0.014, hold: 0.15, note_length: 1.0, repeats: 2}
  - {notes: {thumb: 62, middle: 66}, speed: 0.15, depth: 0.014, hold: 0.15, note_length: 1.0}
"""
SHORT_NOTE = "strikes:\n  - {note: 64, speed: 0.15, depth: 0.014, hold: 0.2}\n"
LONG_NOTE = "strikes:\n  - {note: 64, speed: 0.15, depth: 0.014, hold: 5.0}\n"


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningCell]:
    with RunningCell(tmp_path_factory.mktemp("cell"), "--no-jobs", "--view") as running:
        yield running


LONGEST = 250.0  # s that a phrase may take, with what a busy machine makes it play again


def on_both_cells(cell: RunningCell, phrase: str, notes: list[int]) -> dict[int, Any]:
    """For each note a report in which both cells played it alike. Where real-time scheduling is
    not allowed, a busy machine may swallow a note, hold up a device amid a strike or leave a hole
    in a stream: then the phrase is played again. Cells that differ by themselves never get there.
    """
    found: dict[int, Any] = {}
    said: list[str] = []
    announced = cell.record(StrikeMark, "/command/strike")
    cell.observer.reports.clear()

    def compared() -> bool:
        return len(cell.observer.reports) >= len(announced)

    def alike_by_now() -> bool:
        # Also those of a phrase that was given up: some were announced and not played.
        cell.wait_for(compared, "a comparison of each announced strike")
        announced.clear()
        cell.observer.reports.clear()
        played = cell.play(phrase, LONGEST)
        said.append(played.message)
        if not played.success:
            return False
        assert played.strikes >= len(notes), played.message
        cell.wait_for(
            lambda: len(cell.observer.reports) >= played.strikes, "a comparison of each strike"
        )
        reports = list(cell.observer.reports)
        assert [r.keystrokes[0].note for r in reports[: len(notes)]] == notes
        said.extend(f"{r.keystrokes}, {r.signals}" for r in reports)
        found.update({r.keystrokes[0].note: r for r in reports if comparable(r)})
        return set(found) == set(notes)

    cell.wait_for(alike_by_now, lambda: "\n".join(["the same on both cells", *said]), LONGEST)
    return found


def comparable(report: Any) -> bool:
    """Whether both cells played the strike, as the same nominal cell does. How near they are on a
    quiet machine is for benchmarks/graph.py.
    """
    (gap,) = report.keystrokes
    heights = [s for s in report.signals if s.signal == "wrist/state.z"]
    return bool(
        not gap.real_missing
        and not gap.sim_missing
        and heights
        and 0.0 <= gap.err < 0.5
        and gap.real.v_pre == pytest.approx(gap.sim.v_pre, rel=0.5)
        and gap.real.t_hold == pytest.approx(gap.sim.t_hold, abs=0.1)
        and abs(heights[0].lag) < 0.03
        and heights[0].rms_aligned < 2e-3
    )


def fits_its_twin(recording: Recording) -> None:
    """What the diagnosis sees of a strike that nothing held up, played by a nominal cell."""
    assert is_live(recording)
    twin = PianoTwin([recording], live=True)
    nominal = {p.name: p.nominal for p in twin.parameters}
    shares = {"wrist.z": 0.03, "angle": 0.03, "force": 0.05}

    def misfit(block: Any) -> float:
        """The largest of the RMS differences, over what is allowed."""
        (seen,) = twin.simulate([block], nominal, ())
        return max(
            float(np.sqrt(np.mean((block.outputs[n].y - np.asarray(seen[n])) ** 2)))
            / (share * float(np.ptp(block.outputs[n].y)))
            for n, share in shares.items()
        )

    misfits = [misfit(b) for b in twin.blocks if shares.keys() <= b.outputs.keys()]
    assert min(misfits) < 1.0, misfits


def test_a_phrase_is_played_and_compared_on_both_cells(cell: RunningCell) -> None:
    found = on_both_cells(cell, PHRASE, [64, 64, 62, 66])
    (gap,) = found[64].keystrokes
    assert gap.real.peak_force > 0.1 and gap.sim.peak_force > 0.1, "the key with the force sensor"
    assert {s.signal for s in found[64].signals} <= {
        "wrist/state.z",
        "vacuum/state.middle",
        "key_angle.64",
        "fsr.force",
    }
    # One line for each strike where there is no screen.
    cell.wait_for(lambda: cell.said().count("note 64") >= 2, cell.said)
    assert (
        "MIDI: socket" in cell.said() or "MIDI: ALSA" in cell.said() or "MIDI: JACK" in cell.said()
    )


def test_killed_nodes_are_noticed_named_and_restarted(cell: RunningCell) -> None:
    before = {name: cell.node(name) for name in ("gap_monitor", "ur5_wrist")}
    drivers = before["ur5_wrist"].children(recursive=True)
    assert drivers, "the arm's driver is a process of its own"
    cell.family()

    def compared() -> str | None:
        """How many strikes the monitor says that it has compared."""
        return cell.observer.values.get("gap_monitor", {}).get("strikes")

    cell.wait_for(lambda: compared() not in (None, "0"), "strikes that the monitor has counted")
    for process in before.values():
        process.kill()
    for name, process in before.items():
        cell.wait_for(
            lambda n=name: f"{n} died (SIGKILL)" in cell.said(), f"the death of {name} is told"
        )
        cell.wait_for(lambda n=name: f"{n} restarted" in cell.said(), f"{name} is started again")
        cell.wait_for(
            lambda n=name, p=process: (q := cell.node(n)) and q.pid != p.pid, f"a new {name}"
        )
    assert "the arm stops by itself" in cell.said()
    cell.wait_for(lambda: not living(drivers), "the killed node's driver ends too")
    # What the killed one said last may still arrive; only the new one has counted none.
    cell.wait_for(lambda: compared() == "0", "the new monitor says how it is")
    cell.wait_for(lambda: cell.play(SHORT_NOTE, LONGEST).success, "a phrase after the restart")
    on_both_cells(cell, SHORT_NOTE, [64])


def test_ctrl_c_amid_a_note_leaves_no_process_no_port_and_no_sounding_note(
    cell: RunningCell,
) -> None:
    cell.start(LONG_NOTE)
    cell.wait_for(lambda: cell.status("midi")["sounding"], "a note sounds")
    family = cell.family()
    devices = cell.devices()
    ports = listening(family)
    assert ports, "the emulated arm listens"
    assert cell.process.end(signal.SIGINT, 120.0) == 0, cell.said()
    # The piano's last words.
    assert "while notes sounded" not in (cell.run / "log" / "emulator.log").read_text()
    assert "did not end" not in cell.said() and cell.said().rstrip().endswith("stopped")
    assert not devices.exists(), "links and control sockets of the emulated devices"
    wait_for(lambda: not living(family.values()), lambda: f"the end of {living(family.values())}")
    for host, port in ports:
        with socket.socket() as probe:
            assert probe.connect_ex((host, port)) != 0, f"{host}:{port} still listens"


def listening(family: dict[int, psutil.Process]) -> set[tuple[str, int]]:
    found = set()
    for process in family.values():
        with contextlib.suppress(psutil.NoSuchProcess):
            found |= {
                (c.laddr.ip, c.laddr.port)
                for c in process.net_connections("tcp")
                if c.status == psutil.CONN_LISTEN
            }
    return found


def test_the_bag_holds_both_cells_and_other_readers_open_it(cell: RunningCell) -> None:
    bag = cell.run / "bag"
    assert is_whole(bag)
    with AnyReader([bag]) as reader:  # which checks each type's hash
        counts = {c.topic: c.msgcount for c in reader.connections}
        times = [time for _, time, _ in reader.messages()]
    recorded = [raw.log_time for raw in read_raw(bag)]
    assert recorded == sorted(recorded) and len(recorded) == len(times)
    assert counts["/command/strike"] >= 6 and counts["/gap/live"] >= 5
    assert {
        f"/{c}/{t}"
        for c in ("real", "sim")
        for t in ("wrist/state", "vacuum/state", "fsr", "midi", "keystroke")
    } <= set(counts)
    recording = read_bag(bag)
    assert [s.note for s in recording.strikes[:4]] == [64, 64, 62, 66]
    for name in (
        "command/wrist.position",
        "real/wrist/state.position",
        "sim/wrist/state.position",
        "real/fsr.force",
    ):
        assert len(recording.signal(name).time) > 100
    for name in ("real", "sim"):
        assert sum(e.on for e in recording.notes[name]) >= 5
    held: set[int] = set()
    for event in recording.notes["real"]:
        (held.add if event.on else held.discard)(event.note)
    real, asked = (
        float(recording.signal(name).value[-1, 2])
        for name in ("real/wrist/state.position", "command/wrist.position")
    )
    # An arm that did not get up, since its setpoints came too late to be obeyed, holds its key.
    assert not held or real < asked - 2e-3, "every note of the piano ends in the bag"
    fits_its_twin(recording)
