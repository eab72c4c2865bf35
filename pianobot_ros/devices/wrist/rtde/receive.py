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
from typing import Any

from pianobot_ros.cell.errors import DeviceError
from pianobot_ros.devices.wrist.messages import RawReading
from pianobot_ros.devices.wrist.rtde.control import RTDE_PORT, Modes

__all__ = ["StateReceiver"]

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
_STATE = struct.Struct(">diiIdd36d")  # these, in a package behind the number of its recipe
_HEADER = struct.Struct(">HB")  # size of the whole message, and its type
_VERSION, _OUTPUTS, _START, _PACKAGE = 86, 79, 83, 85
_FIRST_PACKAGE = 2.0  # s in which each answer, and the first package, must have come
_MOST = 1 << 16  # bytes that one look takes


class StateReceiver:
    """Receives from ``host`` at ``rate`` Hz; returns once a first package is there.

    Raises:
        DeviceError: no package came, or the controller does not know what is asked for.
    """

    def __init__(self, host: str, rate: float) -> None:
        self._sequence, self._rest = 0, b""
        self._state: tuple[Any, ...] = (-math.inf,)
        self._socket = socket.create_connection((host, RTDE_PORT), _FIRST_PACKAGE)
        try:
            self._begin(rate)
        except TimeoutError:
            raise DeviceError(
                "the UR controller accepted the connection but sends no state"
            ) from None
        self.modes = self.read_modes()

    def _begin(self, rate: float) -> None:
        self._ask(_VERSION, struct.pack(">H", 2))
        names = ",".join(_TYPES).encode()
        answer = self._ask(_OUTPUTS, struct.pack(">d", rate) + names)[1:].decode("ascii", "replace")
        if answer.split(",") != list(_TYPES.values()):
            raise DeviceError(f"the UR controller does not send what it is asked for: {answer}")
        if self._ask(_START)[:1] != b"\x01":
            raise DeviceError("the UR controller refuses to send its state")
        deadline = time.monotonic() + _FIRST_PACKAGE
        self._socket.setblocking(False)
        while not self.receive():
            if time.monotonic() > deadline:
                raise TimeoutError
            select.select([self], [], [], _FIRST_PACKAGE)

    def _ask(self, kind: int, payload: bytes = b"") -> bytes:
        """Send a message; returns what the answer of its kind says."""
        self._socket.sendall(_HEADER.pack(_HEADER.size + len(payload), kind) + payload)
        deadline = time.monotonic() + _FIRST_PACKAGE
        while time.monotonic() < deadline:
            for answered, said in self._messages():
                if answered == kind:
                    return said
        raise TimeoutError

    def _messages(self) -> list[tuple[int, bytes]]:
        """Type and content of each message that is complete with what waits. Raises DeviceError if
        the connection is lost.
        """
        try:
            data = self._socket.recv(_MOST)
        except BlockingIOError:
            return []
        except ConnectionError:
            data = b""
        if not data:
            raise DeviceError("the UR controller closed the connection")
        data = self._rest + data
        found, begin = [], 0
        while begin + _HEADER.size <= len(data):
            size, kind = _HEADER.unpack_from(data, begin)
            if size < _HEADER.size:
                raise DeviceError("the UR controller sends what is no RTDE message")
            if begin + size > len(data):
                break
            found.append((kind, data[begin + _HEADER.size : begin + size]))
            begin += size
        self._rest = data[begin:]
        return found

    def fileno(self) -> int:
        """What to wait for."""
        return self._socket.fileno()

    def receive(self) -> bool:
        """Take in what has come; says whether a new state is among it. Of several the newest
        counts, and one of the same cycle is none. Raises DeviceError if the connection is lost.
        """
        newest = None
        while messages := self._messages():  # a process that was held up has much to read
            for kind, content in messages:
                if kind == _PACKAGE and len(content) == 1 + _STATE.size:
                    newest = content
        if newest is None:
            return False
        before, self._state = self.stamp, _STATE.unpack_from(newest, 1)
        return self.stamp != before

    @property
    def stamp(self) -> float:
        """The controller's time in the newest package, s."""
        return float(self._state[0])

    @property
    def target(self) -> tuple[float, ...]:
        """Pose (6,) that the controller says it is following."""
        return self._state[18:24]

    def read_modes(self) -> Modes:
        """Renew and return ``modes``."""
        self.modes = Modes(*self._state[1:4])
        return self.modes

    def reading(self, now: float, time_ns: int, **own: Any) -> RawReading:
        """The newest package, noticed at ``now`` (monotonic s), of the cycle at ``time_ns``;
        ``own``: what the driver knows of itself.
        """
        s = self._state
        self._sequence += 1
        return RawReading(
            sequence=self._sequence,
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

    def disconnect(self) -> None:
        """Let the controller go."""
        self._socket.close()
