"""The receiver of the controller's states, against a controller that says what it likes."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator

import pytest

from pianobot_ros.cell.errors import DeviceError
from pianobot_ros.devices.wrist.messages import RawReading
from pianobot_ros.devices.wrist.rtde.control import RTDE_PORT
from pianobot_ros.devices.wrist.rtde.receive import StateReceiver, StateStream
from pianobot_ros.devices.wrist.rtde.wire import Framer, MessageType, frame
from pianobot_ros.emulator.wrist.controller_process import loopback_address
from pianobot_ros.testing import wait_for

TYPES = "DOUBLE,INT32,INT32,UINT32,DOUBLE,DOUBLE" + 6 * ",VECTOR6D"
CLOSED = "closed the connection"


def package(stamp: float) -> bytes:
    numbers = (stamp, 1, 7, 2, 0.5, 0.5, *(float(i) for i in range(36)))
    return frame(MessageType.DATA_PACKAGE, b"\x01" + struct.pack(">diiIdd36d", *numbers))


class Controller:
    """Answers one client as ``answers`` say, by type of message, and sends a first package."""

    def __init__(self, types: str = TYPES) -> None:
        self.host = loopback_address()
        self._listener = socket.create_server((self.host, RTDE_PORT))
        text = frame(MessageType.TEXT_MESSAGE, b"hello")
        self._answers = {
            MessageType.REQUEST_PROTOCOL_VERSION: text + frame(86, b"\x01"),
            MessageType.SETUP_OUTPUTS: frame(79, b"\x01" + types.encode()),
            MessageType.START: frame(83, b"\x01"),
        }
        self.client = socket.socket()
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        self.client, _ = self._listener.accept()
        framer = Framer()
        with contextlib.suppress(OSError):
            while data := self.client.recv(4096):
                for kind, _ in framer.feed(data):
                    self.client.sendall(self._answers[kind])
                    if kind == MessageType.START:
                        time.sleep(0.05)  # its next cycle
                        self.client.sendall(package(1.0))

    def close(self) -> None:
        self.client.close()
        self._listener.close()


@pytest.fixture
def controller() -> Iterator[Controller]:
    made = Controller()
    yield made
    made.close()


def comes(receiver: StateReceiver) -> None:
    wait_for(receiver.receive, "a package")


def test_the_newest_of_several_packages_counts_however_they_are_cut(
    controller: Controller,
) -> None:
    receiver = StateReceiver(controller.host, 125.0)
    assert receiver.stamp == 1.0
    data = package(2.0) + package(3.0) + package(4.0)
    controller.client.sendall(data[:-9])
    comes(receiver)
    assert receiver.stamp == 3.0
    assert not receiver.receive()
    controller.client.sendall(data[-9:])
    comes(receiver)
    reading = receiver.reading(0.0, 0, applied=0, latency=0.0, behind=0.0, servoing=False)
    assert (reading.controller_time, reading.speed_scaling) == (4.0, 0.25)
    assert (reading.pose[0], reading.target[0], reading.current[5]) == (0.0, 12.0, 35.0)
    modes = receiver.read_modes()
    assert (modes.safety, modes.robot, modes.runtime) == (1, 7, 2)
    receiver.disconnect()


def test_a_package_of_the_same_cycle_is_no_news(controller: Controller) -> None:
    receiver = StateReceiver(controller.host, 125.0)
    controller.client.sendall(package(1.0) + package(1.0))
    controller.client.shutdown(socket.SHUT_WR)
    with pytest.raises(DeviceError, match=CLOSED):
        wait_for(receiver.receive, "the end")
    assert receiver.stamp == 1.0


def hangs_up(controller: Controller) -> None:
    controller.client.close()


def speaks_nonsense(controller: Controller) -> None:
    controller.client.sendall(bytes(8))


@pytest.mark.parametrize(("does", "why"), [(hangs_up, CLOSED), (speaks_nonsense, "no RTDE")])
def test_a_link_that_is_lost_says_so(
    controller: Controller, does: Callable[[Controller], None], why: str
) -> None:
    receiver = StateReceiver(controller.host, 125.0)
    controller.client.shutdown(socket.SHUT_RD)  # so that nothing of the client's is left unread
    does(controller)
    with pytest.raises(DeviceError, match=why):
        wait_for(receiver.receive, "the end")


def test_a_controller_without_one_of_the_variables_is_refused() -> None:
    controller = Controller(TYPES.replace("UINT32", "NOT_FOUND"))
    with pytest.raises(DeviceError, match="NOT_FOUND"):
        StateReceiver(controller.host, 125.0)
    controller.close()


def test_a_state_of_the_largest_numbers_is_handed_on() -> None:
    stream = StateStream()
    numbers = (1.0, -(2**31), 2**31 - 1, 2**32 - 1, 1.0, 1.0, *[0.0] * 36)
    body = b"\x01" + struct.pack(">diiIdd36d", *numbers)
    stream.feed(frame(MessageType.DATA_PACKAGE, body))
    own = {"applied": 0, "latency": 0.0, "behind": 0.0, "servoing": False}
    said = RawReading.unpack(stream.reading(1, 0.0, 0, **own).pack())
    assert (said.safety_mode, said.robot_mode, said.runtime_state) == numbers[1:4]
