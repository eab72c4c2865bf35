"""What both emulated microcontrollers share: the loop, the identify line, the faults and the
command line.
"""

from __future__ import annotations

import argparse
import json
import random
import select
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

from pianobot_ros.devices.serial_line import Identity, Line, LineParser, encode
from pianobot_ros.emulator.faults import FaultServer, add_cell_arguments, share_of
from pianobot_ros.emulator.serving.bus import PlantBus
from pianobot_ros.emulator.serving.serial_port import SerialPort
from pianobot_ros.emulator.serving.served import serve

__all__ = ["SerialDevice", "arguments_of", "run_device"]


class SerialDevice(ABC):
    """An emulated microcontroller on a :class:`SerialPort`. A derived class measures and obeys."""

    def __init__(self, port: SerialPort, identity: Identity) -> None:
        self.port = port
        self.identity = identity
        self.stopping = False
        self._parser = LineParser()
        self._sequence = 0
        self._stalled = False
        self._silent = False
        self._garble = 0.0
        self._random = random.Random(1)
        self._boot = time.monotonic()

    # For derived classes.

    @property
    @abstractmethod
    def period(self) -> float:
        """Seconds between two calls of :meth:`measure`."""

    @abstractmethod
    def measure(self, now: float) -> list[tuple[object, ...]]:
        """Kind and fields of the lines that are due at ``now`` (monotonic s)."""

    @abstractmethod
    def obey(self, line: Line) -> str | None:
        """Carry out a command; returns why not, or None. Raises ValueError for bad fields."""

    def status(self) -> dict[str, object]:
        """What the device is doing, for the control socket."""
        return {
            "device": self.identity.device,
            "plugged": self.port.plugged,
            "stalled": self._stalled,
            "silent": self._silent,
            "garble": self._garble,
            "sequence": self._sequence,
            "commands": self._parser.statistics.good,
            "bad_commands": self._parser.statistics.bad,
            "overruns": self.port.overruns,
        }

    def reboot(self) -> None:
        """The device lost its supply with the cable."""
        self._sequence = 0
        self._boot = time.monotonic()
        self._parser.reset()

    def micros(self, now: float) -> int:
        """The microcontroller's clock, 32 bit, at a monotonic time."""
        return round((now - self._boot) * 1e6) & 0xFFFFFFFF

    def where(self) -> str:
        """Its port."""
        return f"at {self.port.link}"

    def close(self) -> None:
        """Take the port away."""
        self.port.close()

    # Faults.

    def handlers(self) -> dict[str, Callable[[Sequence[str]], str | None]]:
        """Words of the control socket."""
        return {
            "unplug": lambda _: self.port.unplug(),
            "replug": lambda _: self._replug(),
            "garble": self._set_garble,
            "silence": lambda _: setattr(self, "_silent", True),
            "stall": lambda _: setattr(self, "_stalled", True),
            "resume": lambda _: self._resume(),
            "status": lambda _: json.dumps(self.status()),
        }

    def _replug(self) -> None:
        if not self.port.plugged:
            self.reboot()
            self.port.plug()

    def _resume(self) -> None:
        self._silent = self._stalled = False

    def _set_garble(self, words: Sequence[str]) -> None:
        self._garble = share_of(words)

    # The loop.

    def run(self, faults: FaultServer | None, stop: Callable[[], bool] = lambda: False) -> None:
        """Serve until ``stopping`` or ``stop()``."""
        due = time.monotonic()
        while not self.stopping and not stop():
            due += self.period
            now = time.monotonic()
            if now - due > 1.0:  # suspended for long: no rush to catch up
                due = now
            while True:
                readers: list[Any] = [self.port] if self.port.plugged and not self._stalled else []
                readers += [faults] if faults else []
                ready, _, _ = select.select(readers, [], [], max(0.0, due - time.monotonic()))
                if faults in ready and faults is not None:
                    faults.service()
                if self.port in ready:
                    self._commands()
                if self.stopping or time.monotonic() >= due:
                    break
            lines = self.measure(due)
            if self.port.plugged and not self._stalled and not self._silent and lines:
                data = b"".join(self._measured(*line) for line in lines)
                self.port.write(data)

    def _measured(self, kind: object, *fields: object) -> bytes:
        data = encode(str(kind), self._sequence, *fields)
        self._sequence = (self._sequence + 1) & 0xFFFF
        return self._spoil(data)

    def _spoil(self, data: bytes) -> bytes:
        if self._garble and self._random.random() < self._garble:
            at = self._random.randrange(len(data))
            how = self._random.randrange(3)
            if how == 0:  # a flipped bit
                return (
                    data[:at]
                    + bytes([data[at] ^ (1 << self._random.randrange(7))])
                    + data[at + 1 :]
                )
            if how == 1:  # lost bytes
                return data[:at] + data[at + 1 + self._random.randrange(8) :]
            return data[:at] + self._random.randbytes(4) + data[at:]  # noise on the wire
        return data

    def _commands(self) -> None:
        for line in self._parser.feed(self.port.read()):
            if line.kind == "Q":
                answer = encode("I", line.sequence, *self.identity.fields())
            else:
                try:
                    problem = self.obey(line)
                except (ValueError, IndexError):
                    problem = f"bad fields of {line.kind}"
                answer = (
                    encode("E", line.sequence, problem) if problem else encode("A", line.sequence)
                )
            self.port.write(self._spoil(answer))


def arguments_of(module: str, description: str | None) -> argparse.ArgumentParser:
    """The command line that both devices have."""
    parser = argparse.ArgumentParser(
        prog=f"python -m pianobot_ros.emulator.{module}", description=description
    )
    parser.add_argument(
        "--link",
        required=True,
        metavar="PATH",
        help="name of the port: a symbolic link is put there",
    )
    add_cell_arguments(parser, "device")
    return parser


def run_device(
    name: str,
    options: argparse.Namespace,
    build: Callable[[SerialPort, PlantBus | None], SerialDevice],
) -> int:
    """Open what the options say, build the device and serve until SIGINT or SIGTERM. Returns the
    exit code.
    """
    return serve(name, options, lambda bus: build(SerialPort(options.link), bus))
