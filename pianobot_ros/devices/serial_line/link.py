"""A serial port with a device behind it that speaks the line protocol: identify, receive, send,
reconnect.
"""

from __future__ import annotations

import os
import select
import threading
import time
from collections.abc import Callable
from typing import Any

from pianobot_ros.devices.attended import Attended
from pianobot_ros.devices.base import DeviceUnavailableError, Health, HealthLevel
from pianobot_ros.devices.serial_line.framing import Line, LineParser, LineStatistics, encode
from pianobot_ros.devices.serial_line.identity import FILES, Identity
from pianobot_ros.devices.serial_line.opening import (
    LINK_ERRORS,
    TURN,
    LinkConfig,
    Opening,
    close_port,
)
from pianobot_ros.devices.serial_line.rhythm import Rhythm
from pianobot_ros.devices.waiting import Waiting

__all__ = ["LinkConfig", "SerialLink"]

MANY_BAD = 0.1  # share of broken lines; a sound cable breaks none
_MOST = 1 << 16  # bytes that one read takes


class SerialLink:
    """Owns the port and a thread that reads it.

    Args:
        config: port and times.
        device: identifier that the device must answer with.
        on_lines: called on the reading thread with the lines of one read and the host time
            (``time.time_ns()``) of it; says whether a measurement was among them.
        on_connect: called on the reading thread after every (re)connection, to set the device up.
        on_event: called with a level and one line of text when the link is lost or comes back, and
            when measurements end or go on (``rhythm``).
    """

    def __init__(
        self,
        config: LinkConfig,
        device: str,
        on_lines: Callable[[list[Line], int], bool],
        *,
        on_connect: Callable[[], None] = lambda: None,
        on_event: Callable[[HealthLevel, str], None] = lambda level, text: None,
    ) -> None:
        self._config = config
        self._device = device
        self._on_lines, self._on_connect, self._on_event = on_lines, on_connect, on_event
        self._port: Any = None
        self._parser = LineParser()
        self._send_lock = threading.Lock()
        self._sequence = 0
        self._thread: Attended | None = None
        self._closing = threading.Event()
        statistics = self._parser.statistics
        self.rhythm = Rhythm(config.path, config.silence_timeout, statistics, on_event)
        self._failure = ""
        self.identity: Identity | None = None
        self.reconnections = 0
        self.send_errors = 0

    # Opening.

    @property
    def path(self) -> str:
        """The port, with ``~`` expanded."""
        return self._config.path

    def connect(self) -> None:
        """Open the port, identify the device and start to read. Raises DeviceUnavailableError,
        saying why.
        """
        if self._thread is not None:
            return
        self._closing.clear()
        self._open()
        self._thread = Attended(self._run, f"serial {self.path}", self._fault)
        self._thread.start()

    def _open(self) -> None:
        opening = Opening(self._config, self._device, FILES.get(self._device, "the configuration"))
        self._port, self.identity = opening.open(self._parser, self._closing)
        self.rhythm.begin()

    # Reading.

    def _fault(self, text: str) -> None:
        self._failure = f"{self.path}: internal error ({text}); the link is opened anew"
        self._drop()
        self._on_event(HealthLevel.ERROR, self._failure)

    def _run(self) -> None:
        while not self._closing.is_set():
            if self._port is None:
                self._reopen()
                continue
            try:
                self._on_connect()
                self._read()
            except LINK_ERRORS as error:
                self._failure = f"{self.path}: link lost ({_short(error)})"
            if self._closing.is_set():
                return
            self._on_event(HealthLevel.ERROR, self._failure)
            self._drop()

    def _read(self) -> None:
        port, parser = self._port, self._parser
        silent_limit = max(3.0 * self._config.silence_timeout, 1.0)
        silence, asked = Waiting(TURN), 0.0  # s of silence at the last question
        while not self._closing.is_set():
            data = _waiting(port)
            if data:
                now_ns = time.time_ns()
                if lines := parser.feed(data):
                    measured = self._on_lines(lines, now_ns)
                    silence.begin()
                    asked = 0.0
                    if measured:
                        self.rhythm.came()
                        continue
            self.rhythm.look()
            silent = silence.turn()
            if silent > silent_limit:
                raise OSError(f"nothing intact for {silent:.1f} s")
            if silent - asked > self._config.silence_timeout:
                asked = silent
                self.send("Q")  # a device that only has nothing to say will answer

    def _reopen(self) -> None:
        while not self._closing.wait(self._config.reconnect_period):
            try:
                self._open()
            except DeviceUnavailableError as error:
                self._failure = str(error)
                continue
            self.reconnections += 1
            self._on_event(
                HealthLevel.OK,
                f"{self.path}: {self.identity.name if self.identity else ''} is back",
            )
            return

    def _drop(self) -> None:
        port, self._port = self._port, None
        close_port(port)

    # Sending.

    def send(self, kind: str, *fields: object) -> bool:
        """Send one line; False if it did not go out. Blocks for at most the write timeout, 0.1
        s.
        """
        with self._send_lock:
            port = self._port
            if port is None:
                return False
            self._sequence += 1
            try:
                port.write(encode(kind, self._sequence, *fields))
            except LINK_ERRORS:  # the reading thread will see it too, and reconnects
                self.send_errors += 1
                return False
            return True

    @property
    def sent(self) -> int:
        """Sequence number of the last line sent."""
        return self._sequence

    # State.

    @property
    def connected(self) -> bool:
        """Whether the port is open and the device was identified. Whether it says anything is
        another matter.
        """
        return self._port is not None

    @property
    def statistics(self) -> LineStatistics:
        """Counters of received lines."""
        return self._parser.statistics

    def health(self) -> Health:
        """Health of the link, with the age of the newest measurement."""
        statistics, age_s = self.statistics, self.rhythm.age
        values: dict[str, float | int | str] = {
            "port": self.path,
            "firmware": self.identity.firmware if self.identity else "",
            "lines": statistics.good,
            "bad_lines": statistics.bad,
            "lost_lines": statistics.lost,
            "device_restarts": statistics.restarts,
            "reconnections": self.reconnections,
            "send_errors": self.send_errors,
            "faults": self._thread.faults if self._thread is not None else 0,
        }
        if not self.connected:
            return Health(
                HealthLevel.ERROR, self._failure or f"{self.path}: not connected", age_s, values
            )
        if self.rhythm.late:
            return Health(
                HealthLevel.STALE, f"{self.path}: no measurement for {age_s:.1f} s", age_s, values
            )
        if statistics.bad_share > MANY_BAD:
            said = f"{self.path}: {statistics.bad_share:.0%} of the lines come broken"
            return Health(HealthLevel.WARN, f"{said}: look at its cable", age_s, values)
        return Health(HealthLevel.OK, "running", age_s, values)

    def close(self) -> None:
        """End the thread and close the port. May be called twice."""
        self._closing.set()
        thread, self._thread = self._thread, None
        if thread is not None and thread is not threading.current_thread():
            thread.join(2.0)
        self._drop()


def _waiting(port: Any) -> bytes:
    """What waits in the port, once something does; empty if nothing comes within its timeout. In
    two system calls, where pyserial's own reading takes five.
    """
    ready, _, _ = select.select([port], [], [], port.timeout)
    if not ready:
        return b""
    try:
        data = os.read(port.fileno(), _MOST)
    except BlockingIOError:
        return b""
    if not data:
        raise OSError("the device is gone, or another program reads its port")
    return data


def _short(error: BaseException) -> str:
    return str(error.args[-1] if error.args else error).split(" (")[0]
