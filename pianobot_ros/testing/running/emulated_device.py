"""Emulated devices for tests, one by one: a process with the device's own protocol and faults."""

from __future__ import annotations

import itertools
import json
import os
import random
import signal
import socket
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from pianobot_ros.cell.host.closing import Closing
from pianobot_ros.emulator.faults import FaultError, send_fault
from pianobot_ros.testing.running.process import Process, Processes
from pianobot_ros.testing.waiting import TIMEOUT, wait_for

__all__ = ["EmulatedDevice", "free_port", "loopback_host"]

_counter = itertools.count(1)


def free_port() -> int:
    """A TCP port of this machine that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def loopback_host() -> str:
    """A loopback address for an emulated arm, whose ports are fixed. Those at 127.0 are left to
    arms with addresses chosen by hand.
    """
    return f"127.{1 + os.getpid() % 250}.{random.randint(1, 254)}.{next(_counter) % 254 + 1}"


def _serial(folder: Path, name: str) -> dict[str, Any]:
    return {"port": str(folder / name)}


_ADDRESSES: Mapping[str, Callable[[Path], dict[str, Any]]] = {
    "wrist": lambda _: {"host": loopback_host()},
    "vacuum": lambda folder: _serial(folder, "vacuum"),
    "fsr": lambda folder: _serial(folder, "fsr"),
    "midi": lambda _: {"transport": "socket", "socket": f"{loopback_host()}:30140"},
}
_WORDS = {"port": "--link", "host": "--host", "transport": "--transport", "socket": "--socket"}


class EmulatedDevice(Closing):
    """A running device of the emulated cell; a context manager that ends it.

    Args:
        name: ``wrist``, ``vacuum``, ``fsr`` or ``midi``.
        folder: for its log, its control socket and the link to its serial port.
        arguments: further words for ``python -m pianobot_ros.emulator.NAME``.
        address: where it is to be found; by default a place of its own.
        environment: variables beside those of this process.

    Attributes:
        parameters: by which the device's node finds it.
        process: the :class:`Process`.

    Raises:
        NotInTime: it did not start; with its own words.
    """

    def __init__(
        self,
        name: str,
        folder: Path,
        *arguments: str,
        address: Mapping[str, Any] | None = None,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self.parameters = dict(_ADDRESSES[name](folder) if address is None else address)
        self.endpoint = f"unix:{folder / (name + '.ctl')}"
        where = [word for key, value in self.parameters.items() for word in (_WORDS[key], value)]
        command = [
            *(
                sys.executable,
                "-m",
                "pianobot_ros.emulator.serving.child",
                f"pianobot_ros.emulator.{name}",
            ),
            *("--faults", self.endpoint, *where, *arguments),
        ]
        self._processes = Processes(folder)
        self.process: Process = self._processes.start(
            *command, log=f"emulated_{name}", env=environment
        )
        try:
            wait_for(self._answers, f"the emulated {name}", TIMEOUT, trouble=self.process.trouble)
        except BaseException:
            self.close()
            raise

    def _answers(self) -> bool:
        try:
            return bool(self.status())
        except FaultError:
            return False

    def fault(self, command: str) -> str:
        """Inject a fault, in the words of ``pianobot_ros.emulator.faults``; returns the answer."""
        return send_fault(self.endpoint, command)

    def status(self) -> dict[str, Any]:
        """What the device says of itself."""
        return dict(json.loads(self.fault("status")))

    def kill(self) -> None:
        """Let it die without a word."""
        self.process.end(signal.SIGKILL)

    def close(self) -> None:
        """End it. Safe to call twice."""
        self._processes.close()
