"""Opens a serial port and makes sure that the right device is behind it, or says why not."""

from __future__ import annotations

import contextlib
import termios
import threading
from pathlib import Path
from typing import Any

import serial

from pianobot_ros.cell.numbers.config import Section, quantity
from pianobot_ros.devices.base import DeviceUnavailableError
from pianobot_ros.devices.serial_line.framing import PROTOCOL_VERSION, LineParser, encode
from pianobot_ros.devices.serial_line.identity import DEVICES, Identity
from pianobot_ros.devices.waiting import Waiting

__all__ = ["LINK_ERRORS", "TURN", "LinkConfig", "Opening", "close_port"]

# SerialException is an OSError; the terminal layer has its own; TypeError: closed while reading.
LINK_ERRORS = (OSError, termios.error, TypeError)
"""What pyserial lets through when a device is pulled."""

_QUERY_PERIOD = 0.2  # s between two questions for the identity
_READ_TIMEOUT = 0.1  # s, how soon the reading thread notices that it shall end
_WRITE_TIMEOUT = 0.1  # s
TURN = _READ_TIMEOUT + _WRITE_TIMEOUT
"""Longest turn of a loop that reads a port and now and then asks something, s."""


class LinkConfig(Section):
    """Section ``link`` of a serial device's configuration file."""

    port: str
    baud: int = quantity("Bd", low=300, high=4_000_000)
    identify_timeout: float = quantity("s", low=0.1, high=30)
    silence_timeout: float = quantity("s", low=0.02, high=10)
    reconnect_period: float = quantity("s", low=0.05, high=10)

    @property
    def path(self) -> str:
        """The port, with ``~`` expanded; empty if none is set."""
        return str(Path(self.port).expanduser()) if self.port else ""


class Opening:
    """How a port is opened.

    Args:
        config: port and times.
        device: identifier that the device must answer with.
        file: name of the configuration file, for error messages.
    """

    def __init__(self, config: LinkConfig, device: str, file: str) -> None:
        self._config, self._device, self._file = config, device, file
        self._wanted = DEVICES.get(device, device)
        self._path = config.path

    def open(self, parser: LineParser, closing: threading.Event) -> tuple[Any, Identity]:
        """The open port and who is there.

        Args:
            parser: for the lines that come meanwhile.
            closing: once set, the device is no longer waited for.

        Raises:
            DeviceUnavailableError: says what is wrong and what to do.
        """
        if not self._path:
            raise DeviceUnavailableError(
                f"no port is set for the {self._wanted}: set 'port' in {self._file}"
            )
        try:
            port = serial.Serial(
                self._path,
                self._config.baud,
                timeout=_READ_TIMEOUT,
                write_timeout=_WRITE_TIMEOUT,
                exclusive=True,
            )
        except (*LINK_ERRORS, ValueError) as error:
            raise DeviceUnavailableError(self._why_not_open(error)) from error
        try:
            return port, self._identify(port, parser, closing)
        except BaseException:
            close_port(port)
            raise

    def _why_not_open(self, error: BaseException) -> str:
        number = getattr(error, "errno", None)
        if not Path(self._path).exists():
            return f"no {self._wanted} at {self._path}: plug it in, or set 'port' in {self._file}"
        if number == 13:
            return (
                f"no permission to open {self._path}: add your user to the group that owns it"
                " (often 'dialout')"
            )
        if "exclusively lock" in str(error) or number == 16:
            return (
                f"{self._path} is in use by another process: end it, or set another 'port' in"
                f" {self._file}"
            )
        return (
            f"cannot open {self._path} for the {self._wanted} ({error}): check 'port' and 'baud'"
            f" in {self._file}"
        )

    def _identify(self, port: Any, parser: LineParser, closing: threading.Event) -> Identity:
        """Ask who is there until it answers."""
        parser.reset()
        good_before, bad_before = parser.statistics.good, parser.statistics.bad
        received = 0
        waiting, ask_at = Waiting(TURN), 0.0
        while waiting.turn() < self._config.identify_timeout and not closing.is_set():
            try:
                if waiting.seconds >= ask_at:
                    port.write(encode("Q", 0))
                    ask_at = waiting.seconds + _QUERY_PERIOD
                data = port.read(max(1, port.in_waiting))
            except serial.SerialTimeoutException:
                continue
            except LINK_ERRORS as error:
                raise DeviceUnavailableError(
                    f"{self._path} went away while the {self._wanted} was asked for"
                ) from error
            received += len(data)
            for line in parser.feed(data):
                if (identity := Identity.from_line(line)) is not None:
                    self._check(identity)
                    return identity
        good, bad = parser.statistics.good - good_before, parser.statistics.bad - bad_before
        why = self._why_unknown(received, good, bad)
        raise DeviceUnavailableError(f"no {self._wanted} at {self._path}: {why} (see {self._file})")

    def _why_unknown(self, received: int, good: int, bad: int) -> str:
        """The most likely reason, from the count of bytes and of intact and broken lines."""
        if received == 0:
            return "nothing answers: is the device on, and is this its port?"
        if good <= bad:  # one or another line of noise is intact by chance
            intact = f"only {good} of {good + bad} lines are" if good else "no line is"
            return (
                f"{received} bytes came but {intact} intact: wrong 'baud' ({self._config.baud})?"
                " or another device?"
            )
        return (
            "lines arrive but none says which device it is: is its firmware older than this"
            " protocol?"
        )

    def _check(self, identity: Identity) -> None:
        if identity.device != self._device:
            raise DeviceUnavailableError(
                f"{self._path}: this is the {identity.name}, not the {self._wanted}: set 'port' in"
                f" {self._file} to the other one"
            )
        if identity.protocol != PROTOCOL_VERSION:
            raise DeviceUnavailableError(
                f"{self._path}: the {self._wanted} speaks protocol version {identity.protocol}, "
                f"this driver version {PROTOCOL_VERSION}: update the older of the two"
            )


def close_port(port: Any) -> None:
    """Close a port that may already be gone, or None."""
    if port is not None:
        with contextlib.suppress(*LINK_ERRORS):
            port.close()
