"""The controller's state packages, straight from its RTDE port (Universal Robots, "Real-Time Data
Exchange (RTDE) Guide", protocol version 2).

The client library has a receiver too. Its thread looks for a package every 0.1 ms, and who wants to
know of one has to look as well: thousands of wake-ups a second, where waiting for the connection
takes one for each package.
"""

from __future__ import annotations

import math
import select
import socket
import struct
import time
from collections.abc import Iterator
from typing import Any

from pianobot_ros.cell.errors import DeviceError
from pianobot_ros.devices.wrist.messages import RawReading
from pianobot_ros.devices.wrist.rtde.control import RTDE_PORT, Modes
from pianobot_ros.devices.wrist.rtde.wire import FORMATS, Framer, MessageType, frame

__all__ = ["StateReceiver", "StateStream"]

_TYPES = {
    "timestamp": "DOUBLE",
    "safety_mode": "INT32",
    "robot_mode": "INT32",
    "runtime_state": "UINT32",
    "speed_scaling": "DOUBLE",
    "target_speed_fraction": "DOUBLE",
    "actual_TCP_pose": "VECTOR6D",
    "actual_TCP_speed": "VECTOR6D",
    "target_TCP_pose": "VECTOR6D",
    "actual_q": "VECTOR6D",
    "actual_qd": "VECTOR6D",
    "actual_current": "VECTOR6D",
}
_STATE = struct.Struct(">" + "".join(FORMATS[kind] for kind in _TYPES.values()))
_FIRST_PACKAGE = 2.0  # s in which each answer, and the first package, must have come
_MOST = 1 << 16  # bytes that one read takes
_READS = 16  # in one look: one who sends faster than is read would hold up the setpoints


class StateStream:
    """The newest ``state`` in what a controller sends; before the first one, of time -inf."""

    def __init__(self) -> None:
        self._framer = Framer()
        self.state: tuple[Any, ...] = (-math.inf,)

    def messages(self, data: bytes) -> Iterator[tuple[int, bytes]]:
        """Type and content of each message that ``data`` completes. Raises DeviceError if it cannot
        be followed.
        """
        try:
            yield from self._framer.feed(data)
        except ValueError as error:
            raise DeviceError(f"the UR controller sends what is no RTDE: {error}") from None

    def feed(self, data: bytes) -> None:
        """Take in what has come; of several packages the newest counts."""
        newest = None
        for kind, content in self.messages(data):
            # behind the number of the recipe
            if kind == MessageType.DATA_PACKAGE and len(content) == 1 + _STATE.size:
                newest = content
        if newest is not None:
            self.state = _STATE.unpack_from(newest, 1)

    def reading(self, sequence: int, now: float, time_ns: int, **own: Any) -> RawReading:
        """The state as the ``sequence``-th reading, noticed at ``now`` (monotonic s), of the cycle
        at ``time_ns``; ``own``: what the driver knows of itself.
        """
        s = self.state
        return RawReading(
            sequence=sequence,
            time_ns=time_ns,
            monotonic=now,
            controller_time=s[0],
            safety_mode=s[1],
            robot_mode=s[2],
            runtime_state=s[3],
            speed_scaling=s[4] * s[5],
            pose=s[6:12],
            speed=s[12:18],
            target=s[18:24],
            q=s[24:30],
            qd=s[30:36],
            current=s[36:42],
            **own,
        )


class StateReceiver:
    """Receives from ``host`` at ``rate`` Hz; returns once a first package is there.

    Raises:
        DeviceError: no package came, or the controller does not know what is asked for.
    """

    def __init__(self, host: str, rate: float) -> None:
        self._sequence, self._stream = 0, StateStream()
        self._socket = socket.create_connection((host, RTDE_PORT), _FIRST_PACKAGE)
        try:
            self._begin(rate)
        except TimeoutError:
            raise DeviceError(
                "the UR controller accepted the connection but sends no state"
            ) from None
        self.modes = self.read_modes()

    def _begin(self, rate: float) -> None:
        self._ask(MessageType.REQUEST_PROTOCOL_VERSION, struct.pack(">H", 2))
        names = ",".join(_TYPES).encode()
        answer = self._ask(MessageType.SETUP_OUTPUTS, struct.pack(">d", rate) + names)
        types = answer[1:].decode("ascii", "replace")
        if types.split(",") != list(_TYPES.values()):
            raise DeviceError(f"the UR controller does not send what it is asked for: {types}")
        if self._ask(MessageType.START)[:1] != b"\x01":
            raise DeviceError("the UR controller refuses to send its state")
        deadline = time.monotonic() + _FIRST_PACKAGE
        self._socket.setblocking(False)
        while not self.receive():
            if time.monotonic() > deadline:
                raise TimeoutError
            select.select([self], [], [], _FIRST_PACKAGE)

    def _ask(self, kind: int, payload: bytes = b"") -> bytes:
        """Send a message; returns what the answer of its kind says."""
        self._socket.sendall(frame(kind, payload))
        deadline = time.monotonic() + _FIRST_PACKAGE
        while time.monotonic() < deadline:
            for answered, said in self._stream.messages(self._read()):
                if answered == kind:
                    return said
        raise TimeoutError

    def _read(self) -> bytes:
        """What waits; empty if nothing does. Raises DeviceError if the connection is lost."""
        try:
            data = self._socket.recv(_MOST)
        except BlockingIOError:
            return b""
        except ConnectionError:
            data = b""
        if not data:
            raise DeviceError("the UR controller closed the connection")
        return data

    def fileno(self) -> int:
        """What to wait for."""
        return self._socket.fileno()

    def receive(self) -> bool:
        """Take in what has come; says whether a new state is among it: one of the same cycle is
        none. Raises DeviceError if the connection is lost.
        """
        before = self.stamp
        for _ in range(_READS):  # a process that was held up has much to read
            if not (data := self._read()):
                break
            self._stream.feed(data)
        return self.stamp != before

    @property
    def stamp(self) -> float:
        """The controller's time in the newest package, s."""
        return float(self._stream.state[0])

    @property
    def target(self) -> tuple[float, ...]:
        """Pose (6,) that the controller says it is following."""
        return self._stream.state[18:24]

    def read_modes(self) -> Modes:
        """Renew and return ``modes``."""
        self.modes = Modes(*self._stream.state[1:4])
        return self.modes

    def reading(self, now: float, time_ns: int, **own: Any) -> RawReading:
        """The newest package as a reading (see :meth:`StateStream.reading`)."""
        self._sequence += 1
        return self._stream.reading(self._sequence, now, time_ns, **own)

    def disconnect(self) -> None:
        """Let the controller go."""
        self._socket.close()
