"""The whole cell as a user runs it: ``pianobot up --emulated`` plays, compares, records, survives kills and leaves nothing.

One graph for the module; its tests build on one another, in the order of the file.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from rosbags.rosbag2 import Reader

from pianobot_ros.bags.read import read_bag
from pianobot_ros.bags.repair import is_whole
from pianobot_ros.cell.recording import Recording
from pianobot_ros.cell_gap.link import is_live
from pianobot_ros.cell_gap.twin import PianoTwin
from pianobot_ros.emulator.faults import FaultError, send_fault
from pianobot_ros.graph import NODES

pytestmark = [pytest.mark.graph, pytest.mark.slow, pytest.mark.timeout(600)]

READY = 120.0  # s, on a busy machine that compiles the plant first
PHRASE = """
strikes:
  - {note: 64, speed: 0.15, depth: 0.014, hold: 0.15, note_length: 1.0, repeats: 2}
  - {notes: {thumb: 62, middle: 66}, speed: 0.15, depth: 0.014, hold: 0.15, note_length: 1.0}
"""
SHORT_NOTE = "strikes:\n  - {note: 64, speed: 0.15, depth: 0.014, hold: 0.2}\n"
LONG_NOTE = "strikes:\n  - {note: 64, speed: 0.15, depth: 0.014, hold: 5.0}\n"


class Cell:
    """``pianobot up --emulated`` in a process, and an observer of its graph in this one."""

    def __init__(self, folder: Path) -> None:
        from pianobot_ros.nodes.observer import Observer

        self.run, self.log = folder / "run", folder / "up.log"
        words = ["-m", "pianobot_ros.cli.app", "up", "--emulated", "--no-tui", "--no-jobs", "--run", str(self.run)]
        with self.log.open("wb") as output:
            self.process = subprocess.Popen(
                [sys.executable, *words], stdin=subprocess.DEVNULL, stdout=output, stderr=output, start_new_session=True,
                env={**os.environ, "PYTHONUNBUFFERED": "1"},
            )  # fmt: skip
        self.family: dict[int, psutil.Process] = {}
        self.observer = Observer("test")

    def said(self) -> str:
        return self.log.read_text(errors="replace")

    def wait(self, condition: Callable[[], Any], limit: float, what: str) -> Any:
        end = time.monotonic() + limit
        while not (value := condition()):
            assert self.process.poll() is None, f"the supervisor ended while waiting for {what}:\n{self.said()}"
            assert time.monotonic() < end, f"not within {limit:g} s: {what}\n{self.said()}"
            self.observer.spin(0.05)
        return value

    def remember(self) -> dict[int, psutil.Process]:
        """Every process of the cell seen so far, the drivers' and devices' own ones too."""
        with contextlib.suppress(psutil.NoSuchProcess):
            self.family |= {p.pid: p for p in psutil.Process(self.process.pid).children(recursive=True)}
        return self.family

    def node(self, name: str) -> psutil.Process | None:
        """The living process of a node."""
        for child in psutil.Process(self.process.pid).children():
            with contextlib.suppress(psutil.NoSuchProcess):
                if f"pianobot_ros.nodes.{name}" in child.cmdline() and child.status() != psutil.STATUS_ZOMBIE:
                    return child
        return None

    def ready(self) -> bool:
        states = self.observer.states()
        names = [spec.name for spec in NODES if not spec.job]
        return self.observer.conductor_ready() and all(states.get(n, ("", ""))[0] in ("ok", "warning") for n in names)

    def start(self, phrase: str) -> Any:
        """Start a phrase; returns the goal's handle."""
        from pianobot_msgs.action import PlayPhrase

        accepted = self.observer.send(PlayPhrase.Goal(phrase_yaml=phrase))
        self.wait(accepted.done, 30, "the conductor's answer")
        assert accepted.result().accepted
        return accepted.result()

    def play(self, phrase: str) -> Any:
        result = self.start(phrase).get_result_async()
        self.wait(result.done, 60, "the end of the phrase")
        return result.result().result

    def devices(self) -> str:
        """Directory of the emulated devices' links."""
        for child in self.remember().values():
            with contextlib.suppress(psutil.NoSuchProcess):
                if "pianobot_ros.emulator" in (words := child.cmdline()):
                    return words[words.index("--directory") + 1]
        raise OSError("no emulated cell")

    def piano(self) -> dict[str, Any]:
        """What the emulated piano says of itself."""
        return dict(json.loads(send_fault(f"unix:{self.devices()}/piano.ctl", "status")))

    def close(self) -> None:
        self.remember()
        self.observer.close()
        if self.process.poll() is None:
            self.process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.process.wait(15)
        for child in [*self.family.values(), self.process]:
            with contextlib.suppress(psutil.NoSuchProcess):
                child.kill()
        self.process.wait(5)


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(random.SystemRandom().randint(1, 100)))
        made = Cell(tmp_path_factory.mktemp("cell"))
        try:
            made.wait(lambda: "ready; Ctrl-C stops everything" in made.said(), READY, "the whole graph ready")
            made.wait(made.ready, 30, "every node's diagnostics")
            yield made
        finally:
            made.close()


def on_both_cells(cell: Cell, phrase: str, notes: list[int]) -> dict[int, Any]:
    """For each note a report in which it sounded on both cells. Where real-time scheduling is not allowed, a busy machine may
    swallow a note or leave a hole in a stream: the monitor says so, and the phrase is played again."""
    found: dict[int, Any] = {}
    for _ in range(3):
        cell.observer.reports.clear()
        played = cell.play(phrase)
        assert played.success and played.strikes == len(notes), played.message
        cell.wait(lambda: len(cell.observer.reports) >= len(notes), 30, "a comparison of each strike")
        reports = list(cell.observer.reports)
        assert [r.keystrokes[0].note for r in reports] == notes
        for report in reports:
            (gap,) = report.keystrokes
            if not gap.real_missing and not gap.sim_missing and "wrist/state.z" in {s.signal for s in report.signals}:
                found[gap.note] = report
        if set(found) == set(notes):
            return found
    pytest.fail(f"of {set(notes)} only {set(found)} sounded on both cells in three phrases")


def fits_its_twin(recording: Recording) -> None:
    """What the diagnosis sees of the first strike, played by a nominal cell before anything was killed."""
    assert is_live(recording)
    twin = PianoTwin([recording], live=True)
    nominal = {p.name: p.nominal for p in twin.parameters}
    (seen,) = twin.simulate(twin.blocks[:1], nominal, ())
    for name, share in (("wrist.z", 0.03), ("angle", 0.03), ("force", 0.05)):
        real = twin.blocks[0].outputs[name].y
        assert np.sqrt(np.mean((real - np.asarray(seen[name])) ** 2)) < share * np.ptp(real), name


def test_a_phrase_is_played_and_compared_on_both_cells(cell: Cell) -> None:
    found = on_both_cells(cell, PHRASE, [64, 64, 62, 66])
    for report in found.values():
        (gap,) = report.keystrokes
        # Both are the nominal cell: what is left is the plant's scatter and one step of the MIDI velocity.
        assert 0.0 <= gap.err < 0.15 and gap.real.v_pre == pytest.approx(gap.sim.v_pre, rel=0.15)
        assert gap.real.t_hold == pytest.approx(gap.sim.t_hold, abs=0.02)
        height = next(s for s in report.signals if s.signal == "wrist/state.z")
        assert abs(height.lag) < 0.004 and height.rms < 5e-4
    (gap,) = found[64].keystrokes
    assert gap.real.peak_force > 0.1 and gap.sim.peak_force > 0.1, "the key with the force sensor"
    assert {s.signal for s in found[64].signals} <= {
        "wrist/state.z", "vacuum/state.middle", "key_angle.64", "fsr.force",
    }  # fmt: skip
    assert cell.said().count("note 64") >= 2, "one line for each strike where there is no screen"
    assert "MIDI: socket" in cell.said() or "MIDI: ALSA" in cell.said() or "MIDI: JACK" in cell.said()


def test_killed_nodes_are_noticed_named_and_restarted(cell: Cell) -> None:
    before = {name: cell.node(name) for name in ("gap_monitor", "ur5_wrist")}
    drivers = before["ur5_wrist"].children(recursive=True)
    assert drivers, "the arm's driver is a process of its own"
    cell.remember()
    for process in before.values():
        process.kill()
    for name, process in before.items():
        cell.wait(lambda n=name: f"{n} died (SIGKILL)" in cell.said(), 30, f"the death of {name} is told")
        cell.wait(lambda n=name: f"{n} restarted" in cell.said(), 30, f"{name} is started again")
        cell.wait(lambda n=name, p=process: (q := cell.node(n)) and q.pid != p.pid, 30, f"a new {name}")
    assert "the arm stops by itself" in cell.said()
    cell.wait(lambda: not any(d.is_running() for d in drivers), 30, "the killed node's driver ends too")
    cell.observer.values.clear()
    cell.wait(lambda: set(before) <= set(cell.observer.values), 30, "both say how they are")
    cell.wait(lambda: cell.play(SHORT_NOTE).success, 60, "a phrase after the restart")
    on_both_cells(cell, SHORT_NOTE, [64])


def test_ctrl_c_amid_a_note_leaves_no_process_no_port_and_no_sounding_note(cell: Cell) -> None:
    cell.start(LONG_NOTE)
    cell.wait(lambda: cell.piano()["sounding"], 30, "a note sounds")
    family = cell.remember()
    devices = cell.devices()
    ports = listening(family)
    assert ports, "the emulated arm listens"
    cell.process.send_signal(signal.SIGINT)
    end, last = time.monotonic() + 60, {}
    while cell.process.poll() is None:
        assert time.monotonic() < end, cell.said()
        with contextlib.suppress(OSError, ValueError, FaultError):
            last = cell.piano()
        time.sleep(0.01)
    assert cell.process.returncode == 0
    assert last["sounding"] == {}, "what the piano said last before it was switched off"
    assert "did not end" not in cell.said() and cell.said().rstrip().endswith("stopped")
    assert not Path(devices).exists(), "links and control sockets of the emulated devices"
    alive = [p for p in family.values() if p.is_running() and p.status() != psutil.STATUS_ZOMBIE]
    assert not alive, [p.cmdline() for p in alive]
    for host, port in ports:
        with socket.socket() as probe:
            assert probe.connect_ex((host, port)) != 0, f"{host}:{port} still listens"


def listening(family: dict[int, psutil.Process]) -> set[tuple[str, int]]:
    found = set()
    for process in family.values():
        with contextlib.suppress(psutil.NoSuchProcess):
            found |= {
                (c.laddr.ip, c.laddr.port) for c in process.net_connections("tcp") if c.status == psutil.CONN_LISTEN
            }
    return found


def test_the_bag_holds_both_cells_and_other_readers_open_it(cell: Cell) -> None:
    bag = cell.run / "bag"
    assert is_whole(bag)
    with Reader(bag) as reader:
        counts = {c.topic: c.msgcount for c in reader.connections}
    assert counts["/command/strike"] >= 6 and counts["/gap/live"] >= 5
    assert {
        f"/{c}/{t}" for c in ("real", "sim") for t in ("wrist/state", "vacuum/state", "fsr", "midi", "keystroke")
    } <= set(counts)
    recording = read_bag(bag)
    assert [s.note for s in recording.strikes[:4]] == [64, 64, 62, 66]
    for name in ("command/wrist.position", "real/wrist/state.position", "sim/wrist/state.position", "real/fsr.force"):
        assert len(recording.signal(name).time) > 100
    for name in ("real", "sim"):
        assert sum(e.on for e in recording.notes[name]) >= 5
    held: set[int] = set()
    for event in recording.notes["real"]:
        (held.add if event.on else held.discard)(event.note)
    assert not held, "every note of the piano ends in the bag"
    fits_its_twin(recording)
