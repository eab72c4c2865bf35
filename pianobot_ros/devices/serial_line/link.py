"""A serial port with a device behind it that speaks the line protocol: identify, receive, send, reconnect."""

from __future__ import annotations

import contextlib
import termios
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import serial

from pianobot_ros.cell.config import Section, quantity
from pianobot_ros.devices.base import DeviceUnavailableError, Health, HealthLevel
from pianobot_ros.devices.serial_line.framing import PROTOCOL_VERSION, Line, LineParser, LineStatistics, encode
from pianobot_ros.devices.serial_line.identity import DEVICES, Identity

__all__ = ["LinkConfig", "SerialLink"]

# What pyserial lets through when a device is pulled: its own, the system's, and the terminal layer's.
_LINK_ERRORS = (OSError, termios.error, TypeError)  # SerialException is an OSError; TypeError: closed while reading

_QUERY_PERIOD = 0.2  # s between two questions for the identity
_READ_TIMEOUT = 0.1  # s, how soon the reading thread notices that it shall end


class LinkConfig(Section):
    """Section ``link`` of a serial device's configuration file."""

    port: str
    baud: int = quantity("Bd", low=300, high=4_000_000)
    identify_timeout: float = quantity("s", low=0.1, high=30)
    silence_timeout: float = quantity("s", low=0.02, high=10)
    reconnect_period: float = quantity("s", low=0.05, high=10)


class SerialLink:
    """Owns the port and a thread that reads it.

    Args:
        config: port and times.
        device: identifier that the device must answer with.
        on_lines: called on the reading thread with the lines of one read and the host time (``time.time_ns()``) of it.
        on_connect: called on the reading thread after every (re)connection, to set the device up.
        on_event: called with a level and one line of text when the link is lost or comes back.
        file: name of the configuration file, for error messages.
    """

    def __init__(
        self,
        config: LinkConfig,
        device: str,
        on_lines: Callable[[list[Line], int], None],
        *,
        on_connect: Callable[[], None] = lambda: None,
        on_event: Callable[[HealthLevel, str], None] = lambda level, text: None,
        file: str = "the configuration",
    ) -> None:
        self._config = config
        self._device = device
        self._on_lines, self._on_connect, self._on_event = on_lines, on_connect, on_event
        self._file = file
        self._port: Any = None
        self._parser = LineParser()
        self._send_lock = threading.Lock()
        self._sequence = 0
        self._thread: threading.Thread | None = None
        self._closing = threading.Event()
        self._last_good = float("-inf")
        self._failure = ""
        self.identity: Identity | None = None
        self.reconnections = 0
        self.send_errors = 0

    # Opening.

    @property
    def path(self) -> str:
        """The port, with ``~`` expanded."""
        return str(Path(self._config.port).expanduser()) if self._config.port else ""

    def connect(self) -> None:
        """Open the port, identify the device and start to read. Raises DeviceUnavailableError, saying why."""
        if self._thread is not None:
            return
        self._closing.clear()
        self._open()
        self._thread = threading.Thread(target=self._run, name=f"serial {self.path}", daemon=True)
        self._thread.start()

    def _open(self) -> None:
        wanted = DEVICES.get(self._device, self._device)
        if not self.path:
            raise DeviceUnavailableError(f"no port is set for the {wanted}: set 'port' in {self._file}")
        try:
            port = serial.Serial(self.path, self._config.baud, timeout=_READ_TIMEOUT, write_timeout=0.1, exclusive=True)
        except (*_LINK_ERRORS, ValueError) as error:
            raise DeviceUnavailableError(self._why_not_open(error, wanted)) from error
        try:
            self.identity = self._identify(port, wanted)
        except BaseException:
            _close(port)
            raise
        self._port = port
        self._last_good = time.monotonic()

    def _why_not_open(self, error: BaseException, wanted: str) -> str:
        number = getattr(error, "errno", None)
        if not Path(self.path).exists():
            return f"no {wanted} at {self.path}: plug it in, or set 'port' in {self._file}"
        if number == 13:
            return f"no permission to open {self.path}: add your user to the group that owns it (often 'dialout')"
        if "exclusively lock" in str(error) or number == 16:
            return f"{self.path} is in use by another process: end it, or set another 'port' in {self._file}"
        return f"cannot open {self.path} for the {wanted} ({error}): check 'port' and 'baud' in {self._file}"

    def _identify(self, port: Any, wanted: str) -> Identity:
        """Ask who is there until it answers; raises with the most likely reason if it is not what is wanted."""
        self._parser.reset()
        before = replace(self._parser.statistics)
        received = 0
        deadline = time.monotonic() + self._config.identify_timeout
        ask_at = 0.0
        while (now := time.monotonic()) < deadline and not self._closing.is_set():
            try:
                if now >= ask_at:
                    port.write(encode("Q", 0))
                    ask_at = now + _QUERY_PERIOD
                data = port.read(max(1, port.in_waiting))
            except serial.SerialTimeoutException:
                continue
            except _LINK_ERRORS as error:
                raise DeviceUnavailableError(f"{self.path} went away while the {wanted} was asked for") from error
            received += len(data)
            for line in self._parser.feed(data):
                if (identity := Identity.from_line(line)) is not None:
                    self._check(identity, wanted)
                    return identity
        good = self._parser.statistics.good - before.good
        if received == 0:
            why = "nothing answers: is the device on, and is this its port?"
        elif good == 0:
            why = f"{received} bytes came but no line is intact: wrong 'baud' ({self._config.baud})? or another device?"
        else:
            why = "lines arrive but none says which device it is: is its firmware older than this protocol?"
        raise DeviceUnavailableError(f"no {wanted} at {self.path}: {why} (see {self._file})")

    def _check(self, identity: Identity, wanted: str) -> None:
        if identity.device != self._device:
            raise DeviceUnavailableError(
                f"{self.path}: this is the {identity.name}, not the {wanted}: set 'port' in {self._file} to the other one"
            )
        if identity.protocol != PROTOCOL_VERSION:
            raise DeviceUnavailableError(
                f"{self.path}: the {wanted} speaks protocol version {identity.protocol}, "
                f"this driver version {PROTOCOL_VERSION}: update the older of the two"
            )

    # Reading.

    def _run(self) -> None:
        while not self._closing.is_set():
            try:
                self._on_connect()
                self._read()
            except _LINK_ERRORS as error:
                self._failure = f"{self.path}: link lost ({_short(error)})"
            if self._closing.is_set():
                return
            self._on_event(HealthLevel.ERROR, self._failure)
            self._drop()
            self._reopen()

    def _read(self) -> None:
        port, parser = self._port, self._parser
        silent_limit = max(3.0 * self._config.silence_timeout, 1.0)
        asked = time.monotonic()
        while not self._closing.is_set():
            data = port.read(1)
            if data:
                waiting = port.in_waiting
                if waiting:
                    data += port.read(waiting)
                now_ns = time.time_ns()
                lines = parser.feed(data)
                if lines:
                    self._last_good = time.monotonic()
                    self._on_lines(lines, now_ns)
                    continue
            silent = time.monotonic() - self._last_good
            if silent > silent_limit:
                raise OSError(f"nothing intact for {silent:.1f} s")
            if silent > self._config.silence_timeout and time.monotonic() - asked > self._config.silence_timeout:
                asked = time.monotonic()
                self.send("Q")  # a device that only has nothing to say will answer

    def _reopen(self) -> None:
        while not self._closing.wait(self._config.reconnect_period):
            try:
                self._open()
            except DeviceUnavailableError as error:
                self._failure = str(error)
                continue
            self.reconnections += 1
            self._on_event(HealthLevel.OK, f"{self.path}: {self.identity.name if self.identity else ''} is back")
            return

    def _drop(self) -> None:
        port, self._port = self._port, None
        _close(port)

    # Sending.

    def send(self, kind: str, *fields: object) -> bool:
        """Send one line; False if it did not go out. Blocks for at most the write timeout, 0.1 s."""
        with self._send_lock:
            port = self._port
            if port is None:
                return False
            self._sequence += 1
            try:
                port.write(encode(kind, self._sequence, *fields))
            except _LINK_ERRORS:  # the reading thread will see it too, and reconnects
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
        """Whether the port is open and the device was identified. Whether it says anything is another matter."""
        return self._port is not None

    @property
    def statistics(self) -> LineStatistics:
        """Counters of received lines."""
        return self._parser.statistics

    def health(self, age_s: float) -> Health:
        """Health of the link, given the age of the newest measurement."""
        statistics = self.statistics
        values: dict[str, float | int | str] = {
            "port": self.path,
            "firmware": self.identity.firmware if self.identity else "",
            "lines": statistics.good,
            "bad_lines": statistics.bad,
            "lost_lines": statistics.lost,
            "device_restarts": statistics.restarts,
            "reconnections": self.reconnections,
            "send_errors": self.send_errors,
        }
        if not self.connected:
            return Health(HealthLevel.ERROR, self._failure or f"{self.path}: not connected", age_s, values)
        if age_s > self._config.silence_timeout:
            return Health(HealthLevel.STALE, f"{self.path}: no measurement for {age_s:.1f} s", age_s, values)
        return Health(HealthLevel.OK, "running", age_s, values)

    def close(self) -> None:
        """End the thread and close the port. May be called twice."""
        self._closing.set()
        thread, self._thread = self._thread, None
        if thread is not None and thread is not threading.current_thread():
            thread.join(2.0)
        self._drop()


def _close(port: Any) -> None:
    if port is not None:
        with contextlib.suppress(*_LINK_ERRORS):
            port.close()


def _short(error: BaseException) -> str:
    return str(error.args[-1] if error.args else error).split(" (")[0]
