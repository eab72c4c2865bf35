"""Faults at run time: one tiny text protocol that every emulated device answers on a loopback
control socket.

A request is one datagram of text, ``COMMAND [ARGUMENT ...]``. The answer is one datagram: ``ok
[text]`` or ``error text``. Each device registers those commands that it has; any other word is
answered with the list of those it knows.

Endpoints are written ``udp:127.0.0.7:30099`` or ``unix:/tmp/pianobot/fsr.ctl``.

A device with a ``select`` loop of its own adds the :class:`FaultServer` to its read set and calls
:meth:`FaultServer.service` when it is readable; a device that blocks elsewhere calls
:meth:`FaultServer.start_thread`.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import socket
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.host.closing import Closing

__all__ = ["COMMANDS", "FaultError", "FaultHandler", "FaultServer", "send_fault", "share_of"]

FaultHandler = Callable[[Sequence[str]], "str | None"]
"""Gets the arguments of a command, returns text for the answer. Raises ValueError on bad arguments.
"""

COMMANDS: Mapping[str, str] = {
    "drop": "[rst]: close every client connection, with a TCP reset if asked",
    "stall": "keep the connections open but neither read nor send",
    "resume": "end stall or silence",
    "refuse": "close the listening ports, so that new connections are refused",
    "accept": "listen again after refuse",
    "pstop": "protective stop",
    "estop": "emergency stop pressed",
    "unlock": "release the protective or emergency stop",
    "killprog": "the running program dies, as on a script error",
    "pause": "pause the running program",
    "play": "continue the paused program",
    "speed": "X: speed slider, 0 to 1",
    "silence": "stop sending measurements, keep reading commands",
    "garble": "RATE: corrupt this share of the sent messages, 0 to 1",
    "unplug": "pull the cable: the device disappears",
    "replug": "put the cable back",
    "status": "what the device is doing, as one JSON object",
}
"""Every word of the protocol with its meaning. A device implements a subset."""

_MAX_DATAGRAM = 8192
_LONGEST_PATH = 107  # bytes, of a socket (unix(7))


def share_of(words: Sequence[str]) -> float:
    """The first word as a share, 0 to 1. Raises ValueError for anything else."""
    share = float(words[0])
    if not 0.0 <= share <= 1.0:
        raise ValueError("the share must be in 0 to 1")
    return share


class FaultError(PianobotError):
    """A fault command was refused by the device, or nothing answered at the endpoint."""


def _parse(endpoint: str) -> tuple[str, str, int]:
    kind, _, rest = endpoint.partition(":")
    if kind == "unix" and rest:
        return kind, rest, 0
    host, _, port = rest.rpartition(":")
    if kind == "udp" and host and port.isdigit():
        if not host.startswith("127."):
            raise FaultError(
                f"fault endpoint '{endpoint}' is not on loopback; use an address 127.x.y.z"
            )
        return kind, host, int(port)
    raise FaultError(f"bad fault endpoint '{endpoint}'; write udp:127.0.0.1:PORT or unix:PATH")


@contextlib.contextmanager
def _fitting(path: str) -> Iterator[str]:
    """A path of the same socket that the kernel takes: at most 107 bytes long. TMPDIR may be
    longer than that; then the way goes through a descriptor of the folder (Linux).
    """
    if len(os.fsencode(path)) <= _LONGEST_PATH:
        yield path
        return
    folder = os.open(Path(path).parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        yield f"/proc/self/fd/{folder}/{Path(path).name}"
    finally:
        os.close(folder)


class FaultServer(Closing):
    """The device's side of the control socket.

    Args:
        endpoint: ``udp:127.x.y.z:PORT`` or ``unix:PATH``. A left-over socket file is replaced.
        handlers: command word to function. Words must come from :data:`COMMANDS`.

    Raises:
        FaultError: the endpoint is malformed, not on loopback, or already in use.
    """

    def __init__(self, endpoint: str, handlers: Mapping[str, FaultHandler]) -> None:
        unknown = sorted(set(handlers) - set(COMMANDS))
        if unknown:
            raise FaultError(
                f"unknown fault command(s) {', '.join(unknown)}; the words are"
                f" {', '.join(COMMANDS)}"
            )
        self.endpoint = endpoint
        self._handlers = dict(handlers)
        self._thread: threading.Thread | None = None
        self._closing = False
        kind, address, port = _parse(endpoint)
        self._path = address if kind == "unix" else None
        self._socket = socket.socket(
            socket.AF_UNIX if self._path else socket.AF_INET, socket.SOCK_DGRAM
        )
        try:
            if self._path:
                with contextlib.suppress(FileNotFoundError):
                    Path(self._path).unlink()
                with _fitting(self._path) as path:
                    self._socket.bind(path)
            else:
                self._socket.bind((address, port))
        except OSError as error:
            self._socket.close()
            raise FaultError(
                f"cannot open the fault endpoint {endpoint}: {error.strerror or error}"
            ) from error

    def fileno(self) -> int:
        """File descriptor, for ``select``."""
        return self._socket.fileno()

    def service(self) -> None:
        """Answer every waiting request, without blocking."""
        while not self._closing:
            try:
                data, sender = self._socket.recvfrom(_MAX_DATAGRAM, socket.MSG_DONTWAIT)
            except OSError:  # nothing (more) waits, or a former client's port is gone
                return
            self._answer(data, sender)

    def start_thread(self) -> None:
        """Serve from a daemon thread. The handlers then run on that thread."""
        self._thread = threading.Thread(
            target=self._serve, name=f"faults {self.endpoint}", daemon=True
        )
        self._thread.start()

    def _serve(self) -> None:
        self._socket.settimeout(0.2)
        while not self._closing:
            try:
                data, sender = self._socket.recvfrom(_MAX_DATAGRAM)
            except TimeoutError:
                continue
            except OSError:
                return
            self._answer(data, sender)

    def _answer(self, data: bytes, sender: Any) -> None:
        words = data.decode("utf-8", "replace").split()
        reply = self._run(words)
        with contextlib.suppress(OSError):  # a client that did not wait for its answer
            self._socket.sendto(reply.encode()[:_MAX_DATAGRAM], sender)

    def _run(self, words: Sequence[str]) -> str:
        handler = self._handlers.get(words[0].lower()) if words else None
        if handler is None:
            word = words[0] if words else ""
            return f"error unknown fault '{word}'; this device knows: {', '.join(self._handlers)}"
        try:
            text = handler(words[1:])
        except (ValueError, IndexError) as error:
            why = "argument missing" if isinstance(error, IndexError) else error
            return f"error {words[0]}: {why}; usage: {words[0]} {COMMANDS[words[0].lower()]}"
        return f"ok {text}" if text else "ok"

    def close(self) -> None:
        """Close the socket, and remove its file if it has one."""
        self._closing = True
        self._socket.close()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(1.0)
        if self._path:
            with contextlib.suppress(FileNotFoundError):
                Path(self._path).unlink()


def send_fault(endpoint: str, command: str, timeout_s: float = 30.0) -> str:
    """Send one command to a device and return the text of its answer (without the leading ``ok``).

    Raises:
        FaultError: nothing answers within ``timeout_s``, or the device refused the command; the
            message says which.
    """
    kind, address, port = _parse(endpoint)
    with socket.socket(
        socket.AF_UNIX if kind == "unix" else socket.AF_INET, socket.SOCK_DGRAM
    ) as client:
        client.settimeout(timeout_s)
        try:
            if kind == "unix":
                client.bind(
                    ""
                )  # Linux gives the client an abstract address of its own to be answered at
                with _fitting(address) as path:
                    client.connect(path)
            else:
                client.connect((address, port))
            client.send(command.encode())
            reply = client.recv(_MAX_DATAGRAM).decode("utf-8", "replace")
        except TimeoutError as error:
            raise FaultError(
                f"no answer from {endpoint} within {timeout_s:g} s; is the emulated device stuck?"
            ) from error
        except OSError as error:
            reason = error.strerror or str(error)
            raise FaultError(
                f"no emulated device at {endpoint} ({reason}); is it running?"
            ) from error
    verdict, _, text = reply.partition(" ")
    if verdict != "ok":
        raise FaultError(f"{endpoint}: {text}")
    return text


def main(arguments: Sequence[str] | None = None) -> int:
    """``python -m pianobot_ros.emulator.faults ENDPOINT COMMAND [ARGUMENT ...]``."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    asked = words in (["-h"], ["--help"])
    if len(words) < 2:
        lines = [f"  {name} {meaning}" for name, meaning in COMMANDS.items()]
        usage = "usage: faults ENDPOINT COMMAND [ARGUMENT ...]\n" + "\n".join(lines)
        print(usage, file=sys.stdout if asked else sys.stderr)
        return 0 if asked else 2
    try:
        print(send_fault(words[0], " ".join(words[1:])) or "ok")
    except FaultError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())


def add_cell_arguments(parser: argparse.ArgumentParser, device: str) -> None:
    """The words that tie an emulated ``device`` to its cell."""
    parser.add_argument(
        "--bus",
        metavar="PATH",
        help=f"shared memory of the emulated cell; without it the {device} is alone",
    )
    parser.add_argument(
        "--faults", metavar="ENDPOINT", help="control socket, udp:127.x.y.z:PORT or unix:PATH"
    )
