"""Starts the emulated cell: plant and devices, each a process of its own, and stops them together.

No process outlives the launcher: the kernel ends a child whose parent dies, and the bus asks all of
them to stop.
"""

from __future__ import annotations

import contextlib
import os
import re
import selectors
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

from pianobot_ros.cell.errors import DeviceError
from pianobot_ros.cell.host.priority import request_realtime
from pianobot_ros.emulator.plant.cases.case import Case
from pianobot_ros.emulator.serving.bus import PlantBus, default_path

__all__ = ["DEVICES", "CellOptions", "EmulatedCell"]

_READY = re.compile(r"\bready\b")
START_TIMEOUT = 540.0  # s: the first start on a machine compiles the plant
STOP_TIMEOUT = 3.0  # s until what does not stop is killed


@dataclass(frozen=True)
class CellOptions:
    """Addresses and kind of the emulated cell. ``directory`` holds links to pseudo-terminals and
    control sockets; ``midi`` overrides ``transport``, ``name`` and ``socket`` of
    ``config/midi.yaml``.
    """

    host: str = "127.0.0.1"
    model: str = "cb3"
    directory: Path = field(default_factory=lambda: Path(tempfile.gettempdir()) / "pianobot")
    bus: Path = field(default_factory=default_path)
    devices: tuple[str, ...] = ("plant", "wrist", "vacuum", "fsr", "midi")
    midi: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class _Device:
    """How to start a device, and what it offers to nodes."""

    command: Callable[[CellOptions], list[str]]
    addresses: Callable[[CellOptions], dict[str, Any]]


def _faults(options: CellOptions, name: str) -> str:
    return f"unix:{options.directory / (name + '.ctl')}"


def _serial(options: CellOptions, name: str) -> list[str]:
    link = str(options.directory / name)
    return [
        f"pianobot_ros.emulator.{name}",
        "--link",
        link,
        "--bus",
        str(options.bus),
        "--faults",
        _faults(options, name),
    ]


def _port(options: CellOptions, name: str) -> dict[str, Any]:
    return {"port": str(options.directory / name), "faults": _faults(options, name)}


def _midi(options: CellOptions) -> list[str]:
    chosen = [word for name, value in options.midi.items() for word in (f"--{name}", value)]
    return [
        "pianobot_ros.emulator.midi",
        "--bus",
        str(options.bus),
        "--faults",
        _faults(options, "midi"),
        *chosen,
    ]


DEVICES: Mapping[str, _Device] = {
    "plant": _Device(
        lambda o: ["pianobot_ros.emulator.plant", "--bus", str(o.bus)],
        lambda o: {"bus": str(o.bus)},
    ),
    "wrist": _Device(
        lambda o: [
            "pianobot_ros.emulator.wrist",
            "--host",
            o.host,
            "--model",
            o.model,
            "--bus",
            str(o.bus),
            "--faults",
            _faults(o, "wrist"),
        ],
        lambda o: {"host": o.host, "model": o.model, "faults": _faults(o, "wrist")},
    ),
    "vacuum": _Device(lambda o: _serial(o, "vacuum"), lambda o: _port(o, "vacuum")),
    "fsr": _Device(lambda o: _serial(o, "fsr"), lambda o: _port(o, "fsr")),
    "midi": _Device(_midi, lambda o: {**o.midi, "faults": _faults(o, "midi")}),
}
"""Every device of the cell in the order of starting. A device prints a line with the word ``ready``
once it can be used.
"""


class EmulatedCell:
    """The running cell. Use as a context manager, or call :meth:`start` and :meth:`stop`."""

    def __init__(
        self,
        case: Case | None = None,
        options: CellOptions | None = None,
        log: IO[str] | None = None,
    ) -> None:
        self.case = case or Case()
        self.options = options or CellOptions()
        self._log = log or sys.stderr
        self._bus: PlantBus | None = None
        self._children: dict[str, subprocess.Popen[bytes]] = {}
        self._selector = selectors.DefaultSelector()
        self._ready: set[str] = set()
        self._rest: dict[str, bytes] = {}

    def addresses(self) -> dict[str, dict[str, Any]]:
        """What nodes need to know, by device."""
        return {name: DEVICES[name].addresses(self.options) for name in self.options.devices}

    def start(self, timeout: float = START_TIMEOUT) -> None:
        """Start everything and wait until every device is ready.

        Raises :class:`DeviceError` if one ends or is not ready in time; then nothing is left
        running.
        """
        self.options.directory.mkdir(parents=True, exist_ok=True)
        if self._someone_lives():
            raise DeviceError(
                f"an emulated cell is running on {self.options.bus} already: stop it or choose"
                " another name"
            )
        self._bus = PlantBus.create(self.options.bus, self.case.to_json())
        environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
        try:
            for name in self.options.devices:
                command = [
                    sys.executable,
                    "-m",
                    "pianobot_ros.emulator.serving.child",
                    *DEVICES[name].command(self.options),
                ]
                child = subprocess.Popen(
                    command,
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.STDOUT,
                    env=environment,
                    start_new_session=True,
                )
                self._children[name] = child
                assert child.stdout is not None
                os.set_blocking(child.stdout.fileno(), False)
                self._selector.register(child.stdout, selectors.EVENT_READ, name)
            deadline = time.monotonic() + timeout
            while waiting := [name for name in self.options.devices if name not in self._ready]:
                self.attend(0.1)
                if time.monotonic() > deadline:
                    raise DeviceError(
                        f"not ready after {timeout:g} s: {', '.join(waiting)}; see its messages"
                        " above"
                    )
            for child in self._children.values():  # real devices wait for nobody
                request_realtime(child.pid)
        except BaseException:
            self.stop()
            raise

    def attend(self, timeout: float) -> None:
        """Pass on what the devices say for up to ``timeout`` s. Raises :class:`DeviceError` if one
        has ended by itself.
        """
        for key, _ in self._selector.select(timeout):
            self._listen(key)
        for name, child in self._children.items():
            if child.poll() is not None:
                for key in list(self._selector.get_map().values()):
                    self._listen(key)
                raise DeviceError(
                    f"the emulated {name} has ended with code {child.returncode}; see its messages"
                    " above"
                )

    def stop(self) -> None:
        """Ask all to stop, then insist. Safe to call twice."""
        if self._bus is not None:
            self._bus.request_stop()
        for send in (subprocess.Popen.terminate, subprocess.Popen.kill):
            alive = [child for child in self._children.values() if child.poll() is None]
            for child in alive:
                send(child)
            deadline = time.monotonic() + STOP_TIMEOUT
            for child in alive:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    child.wait(max(deadline - time.monotonic(), 0.01))
        for key in list(self._selector.get_map().values()):
            self._listen(key)  # their last words
        for key in list(self._selector.get_map().values()):
            self._selector.unregister(key.fileobj)
        for child in self._children.values():
            if child.stdout is not None:
                child.stdout.close()
        self._children.clear()
        self._ready.clear()
        if self._bus is not None:
            self._bus.close()
            self._bus = None

    def _someone_lives(self) -> bool:
        if not self.options.bus.exists():
            return False
        try:
            with PlantBus.attach(self.options.bus) as bus:
                return bus.age() < 1.0
        except DeviceError:
            return False

    def _listen(self, key: selectors.SelectorKey) -> None:
        try:
            data = os.read(key.fd, 65536)
        except BlockingIOError:
            return
        if not data:  # the device has ended; attend() finds out why
            self._selector.unregister(key.fileobj)
            return
        *lines, self._rest[key.data] = (self._rest.get(key.data, b"") + data).split(b"\n")
        for line in (raw.decode("utf-8", "replace").rstrip() for raw in lines):
            if _READY.search(line):
                self._ready.add(key.data)
            if line and line != "ready" and self._log is not None:
                print(f"[{key.data}] {line}", file=self._log, flush=True)

    def __enter__(self) -> EmulatedCell:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
