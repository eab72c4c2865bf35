"""Devices whose lines check and are wrong all the same; threads that meet what nobody foresaw."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import cell_devices as cell
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pianobot_ros.devices.attended import Attended
from pianobot_ros.devices.base import HealthLevel
from pianobot_ros.devices.fsr import FsrConfig, FsrDriver, FsrReading
from pianobot_ros.devices.midi import MidiConfig, MidiDriver, MidiMessage
from pianobot_ros.devices.serial_line import (
    FSR_DEVICE,
    REGULATOR_DEVICE,
    Identity,
    Line,
    LineParser,
    encode,
)
from pianobot_ros.devices.vacuum import RegulatorConfig, RegulatorDriver, VacuumReading
from pianobot_ros.emulator.serving.serial_port import SerialPort


class Board:
    """A microcontroller that identifies itself and then sends what the test wants."""

    def __init__(self, link: Path, identity: Identity) -> None:
        self.port = SerialPort(link)
        self._identity = identity
        self._sequence = 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._answer, daemon=True)
        self._thread.start()

    def _answer(self) -> None:
        parser = LineParser()
        while not self._stop.wait(0.005):
            for line in parser.feed(self.port.read()):
                if line.kind == "Q":
                    self.port.write(encode("I", line.sequence, *self._identity.fields()))

    def send(self, kind: str, *fields: object) -> None:
        self._sequence += 1
        self.port.write(encode(kind, self._sequence, *fields))

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self.port.close()


@pytest.fixture
def board(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Board]:
    with contextlib.closing(Board(tmp_path / "port", request.param)) as made:
        yield made


FSR = Identity(FSR_DEVICE, "1.0", features={"bits": "12", "encoder": "1"})
VACUUM = Identity(REGULATOR_DEVICE, "1.0", features={"channels": "3"})


@pytest.mark.parametrize("board", [FSR], indirect=True)
def test_samples_out_of_range_are_dropped_and_counted(board: Board, tmp_path: Path) -> None:
    seen: list[FsrReading] = []
    driver = FsrDriver(cell.linked(FsrConfig.load(), tmp_path / "port"), seen.extend)
    with cell.connected(driver):
        bad = [(1, 2**31, 0), (1, -1, 0), (1, 4096, 0), (2**32, 5, 0), (1, 5, 2**31), (1, 5, 0, 0)]
        for fields in bad:
            board.send("F", *fields)
        board.send("F", 1000, 5, 7)
        cell.until(lambda: seen, "the good sample")
        assert [(r.counts, r.encoder) for r in seen] == [(5, 7)]
        assert driver.health().values["implausible"] == len(bad)
        assert driver.health().level is HealthLevel.OK


@pytest.mark.parametrize("board", [VACUUM], indirect=True)
def test_pressures_out_of_range_are_dropped_and_counted(board: Board, tmp_path: Path) -> None:
    seen: list[VacuumReading] = []
    driver = RegulatorDriver(cell.linked(RegulatorConfig.load(), tmp_path / "port"), seen.append)
    with cell.connected(driver):
        bad = [(1, 0, 0, 0, 0, 0, 10**11), (1, 1, 0, 0, 0, 0, 0), (-1, 0, 0, 0, 0, 0, 0), (1, 2, 3)]
        for fields in bad:
            board.send("P", *fields)
        board.send("P", 1000, 0, 0, -5, 1, 2, 3)
        cell.until(lambda: seen, "the good report")
        assert [r.setpoint for r in seen] == [(0.0, 0.0, -5.0)]
        assert driver.health().values["implausible"] == len(bad)


@pytest.mark.parametrize("board", [FSR], indirect=True)
def test_a_consumer_that_fails_does_not_end_the_stream(board: Board, tmp_path: Path) -> None:
    seen: list[int] = []
    events: list[tuple[HealthLevel, str]] = []

    def take(readings: list[FsrReading]) -> None:
        if readings[0].counts == 13:
            raise ZeroDivisionError("thirteen")
        seen.extend(r.counts for r in readings)

    driver = FsrDriver(
        cell.linked(FsrConfig.load(), tmp_path / "port"), take, lambda *event: events.append(event)
    )
    with cell.connected(driver):
        board.send("F", 1000, 13, 0)
        cell.until(lambda: events and events[-1][0] is HealthLevel.OK, "the link is back")
        assert events[0][0] is HealthLevel.ERROR and "ZeroDivisionError: thirteen" in events[0][1]
        board.send("F", 3000, 14, 0)
        cell.until(lambda: seen == [14], "samples again")
        assert driver.health().values["faults"] == 1


@given(st.lists(st.binary(max_size=5), max_size=50))
def test_midi_takes_notes_and_nothing_else(messages: list[bytes]) -> None:
    seen: list[MidiMessage] = []
    driver = MidiDriver(MidiConfig.load(), seen.append, guard=False)
    for message in messages:
        driver._link._receive(message)
    notes = [m for m in messages if len(m) == 3 and m[0] & 0xE0 == 0x80 and max(m[1:]) < 128]
    assert [(m.note, m.velocity) for m in seen] == [(m[1], m[2]) for m in notes]
    assert driver.health().values["faults"] == 0


def test_a_note_that_upsets_its_consumer_is_counted_and_the_next_one_comes() -> None:
    seen: list[int] = []

    def take(message: MidiMessage) -> None:
        seen.append(message.note)
        if message.note == 60:
            raise KeyError(message.note)

    driver = MidiDriver(MidiConfig.load(), take, guard=False)
    for note in (60, 61):
        driver._link._receive(bytes([0x90, note, 64]))
    assert seen == [60, 61]
    assert driver.health().values["faults"] == 1


@given(
    st.text(st.characters(min_codepoint=0x20, max_codepoint=0x7E), max_size=14),
    st.integers(-5, 5),
    st.integers(0, 5),
)
def test_fields_are_decimal_integers_within_bounds(text: str, low: int, span: int) -> None:
    line = Line("F", 0, (text,))
    wanted = {str(n): n for n in range(low, low + span + 1)}
    try:
        found = line.integers((low, low + span))
    except ValueError:
        assert text not in wanted
    else:
        assert found == [int(text)] and low <= found[0] <= low + span


def test_an_attended_thread_begins_again_and_says_why() -> None:
    reasons: list[str] = []
    calls: list[float] = []
    done = threading.Event()

    def work() -> None:
        calls.append(time.monotonic())
        if len(calls) < 3:
            raise RuntimeError(f"call {len(calls)}")
        done.set()

    thread = Attended(work, "worker", reasons.append, pause=0.0)
    thread.start()
    assert done.wait(60.0)
    thread.join()
    assert thread.faults == 2 and len(calls) == 3
    assert reasons[0].startswith("RuntimeError: call 1 in test_hostile_devices.py:")
