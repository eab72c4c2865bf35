"""RTDE and dashboard of the emulated controller, spoken to with plain sockets."""

from __future__ import annotations

import contextlib
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from pianobot_ros.devices.wrist.rtde.wire import Framer, MessageType, frame
from pianobot_ros.emulator.faults import COMMANDS, FaultError, FaultServer, send_fault
from pianobot_ros.emulator.wrist.controller_process import EmulatedUr
from pianobot_ros.testing import loopback_host, wait_for

pytestmark = pytest.mark.graph
PATIENCE = 60.0  # s that a busy machine may take for an answer


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[EmulatedUr]:
    with EmulatedUr(tmp_path_factory.mktemp("wrist")) as robot:
        yield robot


class Rtde:
    """A client that sends what it is told and reads whole messages."""

    def __init__(self, host: str) -> None:
        self.socket = socket.create_connection((host, 30004), PATIENCE)
        self._framer = Framer()
        self._waiting: list[tuple[int, bytes]] = []

    def read(self) -> tuple[int, bytes]:
        while not self._waiting:
            data = self.socket.recv(4096)
            assert data, "the controller closed the connection"
            self._waiting = list(self._framer.feed(data))
        return self._waiting.pop(0)

    def ask(self, kind: int, payload: bytes = b"") -> bytes:
        self.socket.sendall(frame(kind, payload))
        answer_kind, answer = self.read()
        assert answer_kind == kind
        return answer

    def __enter__(self) -> Rtde:
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()


def test_version_negotiation(robot: EmulatedUr) -> None:
    with Rtde(robot.host) as client:
        assert client.ask(MessageType.REQUEST_PROTOCOL_VERSION, b"\x00\x01") == b"\x00"
        assert client.ask(MessageType.REQUEST_PROTOCOL_VERSION, b"\x00\x02") == b"\x01"
        assert struct.unpack(">4I", client.ask(MessageType.GET_CONTROLLER_VERSION))[:2] == (3, 15)


def test_unknown_output_is_named_and_nothing_is_sent(robot: EmulatedUr) -> None:
    with Rtde(robot.host) as client:
        answer = client.ask(
            MessageType.SETUP_OUTPUTS, struct.pack(">d", 125.0) + b"timestamp,actual_nonsense"
        )
        assert answer == b"\x00DOUBLE,NOT_FOUND"
        assert client.ask(MessageType.START) == b"\x00"


def test_outputs_come_at_the_rate_asked_for(robot: EmulatedUr) -> None:
    with Rtde(robot.host) as client:
        assert client.ask(
            MessageType.SETUP_OUTPUTS, struct.pack(">d", 25.0) + b"timestamp,actual_q"
        ) == (b"\x01DOUBLE,VECTOR6D")
        assert client.ask(MessageType.START) == b"\x01"
        stamps = []
        while len(stamps) < 6:
            kind, payload = client.read()
            assert kind == MessageType.DATA_PACKAGE
            stamps.append(struct.unpack(">Bd6d", payload)[1])
        assert np.diff(stamps) == pytest.approx([0.04] * 5, abs=1e-9)


def test_an_input_belongs_to_the_client_that_asked_first_until_it_leaves(robot: EmulatedUr) -> None:
    names = b"input_int_register_20,input_double_register_20"
    with Rtde(robot.host) as second:
        with Rtde(robot.host) as first:
            assert first.ask(MessageType.SETUP_INPUTS, names) == b"\x01INT32,DOUBLE"
            assert second.ask(MessageType.SETUP_INPUTS, names) == b"\x00IN_USE,IN_USE"
        wait_for(
            lambda: second.ask(MessageType.SETUP_INPUTS, names)[:1] != b"\x00",
            "the inputs to be freed",
        )


def test_a_short_package_is_counted_and_changes_nothing(robot: EmulatedUr) -> None:
    before = robot.status()["events"].get("bad_input", 0)
    with Rtde(robot.host) as client:
        client.ask(MessageType.SETUP_INPUTS, b"input_double_register_21,input_double_register_22")
        client.socket.sendall(frame(MessageType.DATA_PACKAGE, b"\x01" + struct.pack(">d", 1.0)))
        client.ask(
            MessageType.GET_CONTROLLER_VERSION
        )  # answered in order, so the package has been handled
    assert robot.status()["events"]["bad_input"] == before + 1


def test_nonsense_on_the_rtde_port_closes_only_that_connection(robot: EmulatedUr) -> None:
    with Rtde(robot.host) as good, Rtde(robot.host) as bad:
        bad.socket.sendall(b"\x00\x00\x00\x00")
        assert bad.socket.recv(16) == b""
        assert good.ask(MessageType.REQUEST_PROTOCOL_VERSION, b"\x00\x02") == b"\x01"


def test_dashboard_answers_line_by_line(robot: EmulatedUr) -> None:
    with socket.create_connection((robot.host, 29999), PATIENCE) as connection:
        lines = connection.makefile("rw", newline="\n")
        assert lines.readline() == "Connected: Universal Robots Dashboard Server\n"
        for command, answer in {
            "robotmode": "Robotmode: RUNNING",
            "safetymode": "Safetymode: NORMAL",
            "running": "Program running: false",
            "make coffee": "could not understand: 'make coffee'",
            "quit": "Disconnected",
        }.items():
            lines.write(command + "\n")
            lines.flush()
            assert lines.readline() == answer + "\n"


def test_two_robots_cannot_share_an_address(robot: EmulatedUr) -> None:
    second = subprocess.run(
        [sys.executable, "-m", "pianobot_ros.emulator.wrist", "--host", robot.host],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert second.returncode == 2
    assert second.stderr.count("\n") == 1
    assert "--host" in second.stderr


def test_fault_port_names_what_it_knows(robot: EmulatedUr) -> None:
    with pytest.raises(FaultError, match=r"unknown fault 'explode'.*pstop"):
        robot.fault("explode")
    with pytest.raises(FaultError, match="speed X"):
        robot.fault("speed fast")
    with pytest.raises(FaultError, match=r"2 is not in \[0, 1\]"):
        robot.fault("speed 2")


def test_a_protective_stop_is_not_unlocked_early(tmp_path: Path) -> None:
    with EmulatedUr(tmp_path, unlock_delay=3600.0) as robot:
        robot.fault("pstop")
        with pytest.raises(FaultError, match="refuses to unlock"):
            robot.fault("unlock")
        assert robot.status()["safety"] == "PROTECTIVE_STOP"


@pytest.mark.parametrize("kind", ["udp", "unix"])
def test_fault_server_over_both_kinds_of_socket(kind: str, tmp_path: Path) -> None:
    endpoint = f"unix:{tmp_path / 'a.ctl'}" if kind == "unix" else f"udp:{loopback_host()}:38471"
    with FaultServer(
        endpoint, {"garble": lambda words: f"rate {float(words[0]):g}", "stall": lambda _: None}
    ) as server:
        server.start_thread()
        assert send_fault(endpoint, "garble 0.25") == "rate 0.25"
        assert send_fault(endpoint, "STALL") == ""
        with pytest.raises(FaultError, match="argument missing"):
            send_fault(endpoint, "garble")
    with pytest.raises(FaultError, match="is it running"):
        send_fault(endpoint, "stall")


def test_fault_endpoints_stay_on_loopback_and_words_in_the_list() -> None:
    with pytest.raises(FaultError, match="loopback"):
        FaultServer("udp:0.0.0.0:4000", {})
    with pytest.raises(FaultError, match="bad fault endpoint"):
        send_fault("http://somewhere", "status")
    with pytest.raises(FaultError, match="explode"):
        FaultServer("udp:127.0.0.1:38472", {"explode": lambda _: None})
    assert {"drop", "stall", "refuse", "pstop", "estop", "garble", "unplug", "status"} <= set(
        COMMANDS
    )


def test_a_fourth_client_of_the_dashboard_is_refused_in_words(robot: EmulatedUr) -> None:
    def greeting(connection: socket.socket) -> bytes:
        return connection.makefile("rb").readline()

    with contextlib.ExitStack() as held:

        def client() -> socket.socket:
            return held.enter_context(socket.create_connection((robot.host, 29999), PATIENCE))

        allowed = [client() for _ in range(3)]
        assert all(b"Connected" in greeting(c) for c in allowed)
        another = client()
        assert b"Refused" in greeting(another)
        assert another.recv(1) == b""
        allowed[0].sendall(b"running\n")
        assert b"Program running" in greeting(allowed[0])


def test_a_line_without_end_ends_the_connection(robot: EmulatedUr) -> None:
    with (
        socket.create_connection((robot.host, 30003), PATIENCE) as script,
        pytest.raises(ConnectionError),
    ):
        while True:
            script.sendall(b"x" * 65536)
