"""The piano's driver against the emulated piano: over sockets always, over JACK where it is
installed.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import uuid
from collections.abc import Iterator
from pathlib import Path

import cell_devices as cell
import mido
import mido.sockets
import pytest

from pianobot_ros.devices.base import (
    CommandRejectedError,
    DeviceUnavailableError,
    HealthLevel,
)
from pianobot_ros.devices.midi import (
    MidiConfig,
    MidiDriver,
    MidiMessage,
    choose_transport,
    open_transport,
)

ON, OFF = 0x90, 0x80


def config_for(
    address: str,
    transport: str = "socket",
    port: str = "piano",
    client: str = "bridge",
    silence: float = 10.0,
) -> MidiConfig:
    """Nobody is lost who stands still for less than ``silence`` s."""
    config = MidiConfig.load()
    times = {"silence_timeout": silence, "reconnect_period": 0.05}
    where = {"socket": address, "transport": transport, "port": port, "client": client}
    return config.model_copy(update={"link": config.link.model_copy(update={**times, **where})})


@pytest.fixture
def address() -> str:
    return cell.free_address()


@pytest.fixture
def piano(address: str, tmp_path: Path) -> Iterator[cell.Device]:
    arguments = ("--transport", "socket", "--socket", address, "--signal", "0.2")
    with cell.Device("midi", tmp_path, *arguments) as process:
        yield process


@pytest.fixture
def patient(address: str, tmp_path: Path) -> Iterator[cell.Device]:
    """A piano whose notes sound until they are released: without active sensing it does not fall
    silent when this process stands still for a third of a second.
    """
    arguments = ("--transport", "socket", "--socket", address, "--signal", "0.2", "--no-sensing")
    with cell.Device("midi", tmp_path, *arguments) as process:
        yield process


def test_notes_both_ways_and_none_left_at_the_end(patient: cell.Device, address: str) -> None:
    piano = patient
    seen: list[MidiMessage] = []
    with cell.connected(MidiDriver(config_for(address), seen.append)) as driver:
        cell.until(lambda: len(seen) >= 4, "notes of the piano")
        assert {m.channel for m in seen} == {0} and {m.status for m in seen} == {ON, OFF}
        assert driver.write(MidiMessage(ON, 1, 60, 200)).velocity == 127
        driver.write(MidiMessage(ON, 1, 64, 80))
        driver.write(MidiMessage(ON, 1, 64, 0))  # a note-off in disguise
        cell.until(lambda: piano.status()["sounding"] == {"1": [60]}, "note sounds")
        assert driver.held == {(1, 60)}
        with pytest.raises(CommandRejectedError):
            driver.write(MidiMessage(0xB0, 1, 60, 1))
        with pytest.raises(CommandRejectedError):
            driver.write(MidiMessage(ON, 1, 128, 1))
        health = driver.health()
        assert health.level is HealthLevel.OK and "socket" in str(health.values["transport"])
        driver.close()
    cell.until(lambda: piano.status()["sounding"] == {}, "released at close")


def test_what_a_predecessor_left_is_silenced_at_the_start(piano: cell.Device, address: str) -> None:
    loose = open_transport("socket", lambda _: None, client="x", port="x", socket=address)
    loose.send(bytes([ON | 1, 70, 90]))
    cell.until(lambda: piano.status()["sounding"] == {"1": [70]}, "left over note")
    loose.close()
    with cell.connected(MidiDriver(config_for(address), guard=False)):
        cell.until(lambda: piano.status()["sounding"] == {}, "silenced")


@pytest.mark.parametrize("fault", ["silence", "unplug"])
def test_a_dead_piano_is_noticed_and_found_again(
    piano: cell.Device, address: str, fault: str
) -> None:
    events: list[HealthLevel] = []
    config = config_for(address, silence=0.6)
    with cell.connected(
        MidiDriver(config, on_event=lambda level, _: events.append(level), guard=False)
    ) as driver:
        cell.until(lambda: driver.health().values["active_sensing"] == "yes", "active sensing")
        piano.fault(fault)
        cell.until(lambda: driver.health().level is HealthLevel.ERROR, "loss noticed")
        with pytest.raises(DeviceUnavailableError):
            for _ in range(100):
                driver.write(MidiMessage(OFF, 1, 60, 0))
        piano.fault("resume" if fault == "silence" else "replug")
        cell.until(
            lambda: driver.health().level is HealthLevel.OK and events[-1] is HealthLevel.OK, "back"
        )


def test_a_piano_without_active_sensing_is_found_again(patient: cell.Device, address: str) -> None:
    seen: list[MidiMessage] = []
    with cell.connected(MidiDriver(config_for(address), seen.append, guard=False)) as driver:
        patient.fault("unplug")
        cell.until(lambda: driver.health().level is HealthLevel.ERROR, "loss noticed")
        patient.fault("replug")
        cell.until(lambda: driver.health().level is HealthLevel.OK, "back")
        heard = len(seen)
        cell.until(lambda: len(seen) > heard, "its notes")


def test_a_killed_piano_is_noticed(piano: cell.Device, address: str) -> None:
    with cell.connected(MidiDriver(config_for(address), guard=False)) as driver:
        piano.process.kill()
        cell.until(lambda: driver.health().level is HealthLevel.ERROR, "death noticed")


def test_garbled_messages_do_not_stop_it(piano: cell.Device, address: str) -> None:
    seen: list[MidiMessage] = []
    with cell.connected(MidiDriver(config_for(address), seen.append, guard=False)):
        piano.fault("garble 0.5")
        cell.until(lambda: piano.status()["sent"] > 15, "garbled notes sent")
        piano.fault("garble 0")
        start = len(seen)
        cell.until(lambda: len(seen) > start + 4, "good notes again")
        assert all(m.note < 128 and m.velocity < 128 for m in seen)


def test_a_forgotten_note_is_released(patient: cell.Device, address: str) -> None:
    config = config_for(address)
    config = config.model_copy(update={"notes": config.notes.model_copy(update={"longest": 0.5})})
    with cell.connected(MidiDriver(config, guard=False)) as driver:
        driver.write(MidiMessage(ON, 1, 60, 80))
        cell.until(lambda: driver.health().values["forgotten"] == 1, "forgotten note")
        cell.until(lambda: patient.status()["sounding"] == {}, "released")


HOLD_AND_WAIT = """
import sys, time
from pianobot_ros.devices.midi import MidiConfig, MidiDriver, MidiMessage
transport, address, port, client = sys.argv[1:]
config = MidiConfig.load()
link = config.link.model_copy(
    update={"socket": address, "transport": transport, "port": port, "client": client,
            "silence_timeout": 10.0})
driver = MidiDriver(config.model_copy(update={"link": link}))
driver.connect()
print("connected", flush=True)
for _ in range(6000):  # again and again: a piano that heard nothing for too long silences it
    for note in (60, 64, 67):
        driver.write(MidiMessage(0x90, 1, note, 80))
    time.sleep(0.1)
"""


def kill_while_holding(piano: cell.Device, *arguments: str, **extra: str) -> None:
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLD_AND_WAIT, *arguments],
        env=cell.environment(**extra),
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert holder.stdout is not None and "connected" in holder.stdout.readline()
        cell.until(lambda: piano.status()["sounding"] == {"1": [60, 64, 67]}, "chord sounds")
    finally:
        holder.send_signal(signal.SIGKILL)
        holder.wait()
        if holder.stdout:
            holder.stdout.close()
    cell.until(lambda: piano.status()["sounding"] == {}, "chord released after the kill", 30.0)


@pytest.mark.parametrize("sensing", [True, False])
def test_no_note_hangs_after_a_kill(address: str, tmp_path: Path, sensing: bool) -> None:
    arguments = ["--transport", "socket", "--socket", address, "--signal", "0"] + (
        [] if sensing else ["--no-sensing"]
    )
    with cell.Device("midi", tmp_path, *arguments) as piano:
        kill_while_holding(piano, "socket", address, "x", "x")
        if not sensing:  # then it was the guard
            assert piano.status()["silenced_by_sensing"] == 0


def test_errors_say_what_to_do(address: str) -> None:
    with pytest.raises(DeviceUnavailableError, match="no piano listens at"):
        MidiDriver(config_for(address)).connect()
    with pytest.raises(DeviceUnavailableError, match="valid: auto, alsa, jack, socket"):
        choose_transport("usb")
    if not Path("/dev/snd/seq").exists():
        with pytest.raises(DeviceUnavailableError, match="/dev/snd/seq"):
            choose_transport("alsa")


def test_the_socket_speaks_mido(piano: cell.Device, address: str) -> None:
    host, port = address.split(":")
    client = mido.sockets.connect(host, int(port))
    client.send(mido.Message("note_on", channel=2, note=61, velocity=5))
    cell.until(lambda: piano.status()["sounding"] == {"2": [61]}, "note from mido")
    found = cell.until(
        lambda: next((m for m in client.iter_pending() if m.type == "note_on"), None),
        "note to mido",
    )
    assert found.note == 64
    client.close()


@pytest.fixture
def jack(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    jackd = shutil.which("jackd")
    if jackd is None:
        pytest.skip("jackd is not installed")
    name = f"pianobot-{uuid.uuid4().hex[:8]}"
    # For few ports: its usual 103 MB are more shared memory than a container has (64 MB), and where
    # it may lock them it is killed (SIGBUS).
    command = [jackd, "-r", "-S", "-p", "64", "-n", name]
    command += ["-d", "dummy", "-r", "48000", "-p", "64"]
    environment = {**os.environ, "JACK_NO_AUDIO_RESERVATION": "1"}
    server = subprocess.Popen(
        command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    monkeypatch.setenv("JACK_DEFAULT_SERVER", name)
    monkeypatch.setenv("JACK_NO_START_SERVER", "1")

    def runs() -> bool:
        if server.poll() is not None:  # it needs shared memory and threads, as any program of JACK
            pytest.skip(f"jackd does not run here: it has ended with code {server.returncode}")
        try:
            return choose_transport("jack") == "jack"
        except DeviceUnavailableError:
            return False

    try:
        cell.until(runs, "JACK server")
        yield name
    finally:
        server.terminate()
        try:
            server.wait(8.0)
        except subprocess.TimeoutExpired:
            server.kill()
            server.wait()


def test_over_jack_notes_pass_and_none_hangs_after_a_kill(jack: str, tmp_path: Path) -> None:
    assert choose_transport("auto") in ("alsa", "jack")
    arguments = ("--transport", "jack", "--name", "testpiano", "--signal", "0.2", "--no-sensing")
    with cell.Device(
        "midi", tmp_path, *arguments, JACK_DEFAULT_SERVER=jack, JACK_NO_START_SERVER="1"
    ) as piano:
        seen: list[MidiMessage] = []
        driver = MidiDriver(
            config_for("127.0.0.1:9", "jack", "testpiano", "testbridge"), seen.append
        )
        driver.connect()
        try:
            assert "jack" in driver.description and "testpiano" in driver.description
            cell.until(lambda: len(seen) >= 4, "notes over JACK")

            def sounds() -> bool:  # what JACK gets while it cannot keep up goes nowhere
                driver.write(MidiMessage(ON, 1, 60, 90))
                return bool(piano.status()["sounding"] == {"1": [60]})

            cell.until(sounds, "note sounds over JACK")
        finally:
            driver.close()
        cell.until(lambda: piano.status()["sounding"] == {}, "released over JACK")
        kill_while_holding(
            piano, "jack", "127.0.0.1:9", "testpiano", "killed", JACK_DEFAULT_SERVER=jack
        )
