"""The supervisor of a cell: starts the emulated devices and the nodes, watches them, and leaves
nothing behind.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import psutil

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.host.halted import SUPERVISOR, halted, still_living
from pianobot_ros.cell.host.priority import request_high
from pianobot_ros.nodes.graph import NodeSpec, cell_graph, ros_arguments

__all__ = ["Emulation", "Supervisor", "SupervisorError", "new_run_directory"]

EMULATOR_TIMEOUT = 600.0  # s: the first start on a machine compiles the plant
STOP_TIMEOUT = 10.0  # s until a node that does not end is killed; its own limit is 8
HALTED_LIMIT = 1.0  # s that a node may stand still before it is started anew
RESTART_WINDOW = 60.0  # s in which restarts are counted


class SupervisorError(PianobotError):
    """A part of the cell cannot be started or kept running."""


def new_run_directory(base: Path | None = None) -> Path:
    """A fresh ``runs/<date and time>`` with room for logs and the bag."""
    folder = (base or Path("runs")) / time.strftime("%Y-%m-%d_%H-%M-%S")
    number = 1
    while True:
        path = folder if number == 1 else folder.with_name(f"{folder.name}-{number}")
        try:
            path.mkdir(parents=True)
            return path.absolute()
        except FileExistsError:
            number += 1
        except OSError as error:
            raise SupervisorError(
                f"cannot make the run directory {path}: {error.strerror}"
            ) from error


@dataclass(frozen=True)
class Emulation:
    """How the emulated cell is started: words for ``python -m pianobot_ros.emulator``."""

    arguments: tuple[str, ...] = ()


@dataclass
class _Running:
    spec: NodeSpec
    process: subprocess.Popen[bytes]
    log_start: int = 0  # byte of the log at which this process began to write
    halted: float = 0.0  # when it was first seen stopped by a signal, monotonic s; 0: it runs
    starts: deque[float] = field(default_factory=deque)


def _prepare_high() -> None:
    request_high()
    _prepare()


def _prepare() -> None:
    """Between fork and exec: Ctrl-C is heard, and the process ends with its parent."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(1, signal.SIGTERM)  # PR_SET_PDEATHSIG


class Supervisor:
    """Processes of one cell. ``tell`` gets one line for everything that happens."""

    def __init__(
        self, run: Path, tell: Callable[[str], None], environment: dict[str, str] | None = None
    ) -> None:
        self.run, self._tell = run, tell
        self._environment = {
            **os.environ,
            "PYTHONUNBUFFERED": "1",
            SUPERVISOR: str(os.getpid()),
            **(environment or {}),
        }
        self._nodes: dict[str, _Running] = {}
        self._emulator: subprocess.Popen[bytes] | None = None
        self._devices: Path | None = None
        self.addresses: dict[str, dict[str, str]] | None = None
        (run / "log").mkdir(parents=True, exist_ok=True)

    @property
    def pids(self) -> dict[str, int]:
        """Process ids by node, and of the emulated cell."""
        found = {
            name: entry.process.pid
            for name, entry in self._nodes.items()
            if entry.process.poll() is None
        }
        if self._emulator is not None:
            found["emulator"] = self._emulator.pid
        return found

    def start_emulation(self, emulation: Emulation) -> None:
        """Start the emulated devices and learn their addresses."""
        # Not below the run directory, whose file system may know neither links nor sockets.
        self._devices = devices = Path(tempfile.mkdtemp(prefix="pianobot-"))
        name = devices.name.removeprefix("pianobot-")
        command = [
            sys.executable,
            "-m",
            "pianobot_ros.emulator",
            "--name",
            name,
            "--directory",
            str(devices),
        ]
        self._emulator = self._spawn([*command, *emulation.arguments], "emulator", subprocess.PIPE)
        output = self._emulator.stdout
        assert output is not None
        deadline = time.monotonic() + EMULATOR_TIMEOUT
        while not select.select([output], [], [], 0.1)[0]:
            if self._emulator.poll() is not None or time.monotonic() > deadline:
                break
        line = output.readline() if select.select([output], [], [], 0)[0] else b""
        try:
            self.addresses = json.loads(line)
        except json.JSONDecodeError:
            self.stop()
            raise SupervisorError(
                f"the emulated cell did not start: {self._last_line('emulator')}"
            ) from None
        self._tell(f"emulated cell ready: {', '.join(self.addresses or {})}")

    def start_nodes(self, nodes: Sequence[NodeSpec]) -> None:
        """Start the nodes in the given order."""
        for spec in nodes:
            self._nodes[spec.name] = _Running(spec, *self._node(spec))
            self._nodes[spec.name].starts.append(time.monotonic())

    def poll(self) -> None:
        """Notice what has died, name it, and start it again. Call at least every 0.2 s.

        Raises :class:`SupervisorError` when the cell cannot go on; :meth:`stop` is then still to be
        called.
        """
        if self._emulator is not None and (code := self._emulator.poll()) is not None:
            raise SupervisorError(
                f"the emulated cell ended ({_code(code)}): {self._last_line('emulator')}"
            )
        for name, entry in list(self._nodes.items()):
            code, now = entry.process.poll(), time.monotonic()
            if code is None:
                self._look_at(name, entry, now)
                continue
            while entry.starts and entry.starts[0] < now - RESTART_WINDOW:
                entry.starts.popleft()
            # One that ended in order, or that was killed, has said nothing about why.
            told = code not in (0, -signal.SIGKILL)
            why = self._last_line(name, entry.log_start) if told else ""
            ended = "died" if code else "ended"
            self._tell(f"{name} {ended} ({_code(code)})" + (f": {why}" if why else ""))
            if entry.spec.optional and code != 2 and len(entry.starts) > entry.spec.restarts:
                self._tell(f"{name} keeps dying; the cell goes on without it")
                del self._nodes[name]
                continue
            # Bad input does not get better by trying again.
            if code == 2 or len(entry.starts) > entry.spec.restarts:
                raise SupervisorError(
                    f"{name} does not run ({_code(code)}): {why or f'see {self._log(name)}'}"
                )
            if entry.spec.moves:
                self._tell("the arm stops by itself: its stream of setpoints has ended")
            entry.process, entry.log_start = self._node(entry.spec)
            entry.halted = 0.0
            entry.starts.append(now)
            self._tell(f"{name} restarted")

    def _look_at(self, name: str, entry: _Running, now: float) -> None:
        """Name a living node that a signal has stopped; one that stays so is killed, and the next
        look starts it anew.
        """
        if not halted(entry.process.pid):
            entry.halted = 0.0
        elif not entry.halted:
            entry.halted = now
            self._tell(f"{name} was stopped by a signal (SIGSTOP)")
        elif now - entry.halted > HALTED_LIMIT:
            self._tell(f"{name} stands still for {HALTED_LIMIT:g} s and is killed")
            entry.process.kill()
            entry.process.wait()

    def stop(self) -> None:
        """End everything in the reverse order of starting. Safe to call twice."""
        for entry in reversed(self._nodes.values()):
            self._end(entry.process, entry.spec.name)
        self._nodes.clear()
        if self._emulator is not None:
            self._end(self._emulator, "emulator")
            self._emulator = None
        if self._devices is not None:
            shutil.rmtree(self._devices, ignore_errors=True)
            self._devices = None

    def _node(self, spec: NodeSpec) -> tuple[subprocess.Popen[bytes], int]:
        """The started process, and the byte of its log at which it begins."""
        log = self._log(spec.name)
        begin = log.stat().st_size if log.exists() else 0
        command = [sys.executable, "-m", spec.module, *ros_arguments(spec.parameters)]
        return self._spawn(command, spec.name, None, high=not spec.job), begin

    def _spawn(
        self, command: list[str], name: str, output: int | None, *, high: bool = False
    ) -> subprocess.Popen[bytes]:
        """Start a process; ``high``: before ordinary programs from its first instruction on, since
        a node that is started anew on a busy machine would load for half a minute.
        """
        with self._log(name).open("ab") as log:
            # A session of its own: Ctrl-C in the terminal reaches the supervisor only, which stops
            # the rest in order.
            return subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=output or log,
                stderr=log,
                env=self._environment,
                start_new_session=True,
                preexec_fn=_prepare_high if high else _prepare,  # noqa: PLW1509 (system calls only)
            )

    def _end(self, process: subprocess.Popen[bytes], name: str) -> None:
        family: list[psutil.Process] = []
        with contextlib.suppress(psutil.NoSuchProcess):
            family = psutil.Process(process.pid).children(recursive=True)
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(STOP_TIMEOUT)
            except subprocess.TimeoutExpired:
                self._tell(f"{name} did not end within {STOP_TIMEOUT:g} s and was killed")
                process.kill()
                process.wait()
        # What a crashed node left behind, for example the process of its driver.
        for child in still_living(family, 1.0):
            with contextlib.suppress(psutil.NoSuchProcess):
                child.kill()
        if process.stdout is not None:
            process.stdout.close()

    def _log(self, name: str) -> Path:
        return self.run / "log" / f"{name}.log"

    def _last_line(self, name: str, begin: int = 0) -> str:
        """The last line of a log from its byte ``begin`` on that is no mere information; empty if
        there is none.
        """
        try:
            text = self._log(name).read_bytes()[begin:].decode(errors="replace")
        except OSError:
            return ""
        lines = [
            line
            for line in text.splitlines()
            if line.strip() and not line.startswith(("[INFO]", "[DEBUG]"))
        ]
        return lines[-1].strip() if lines else ""


def _code(code: int) -> str:
    if code >= 0:
        return f"exit code {code}"
    with contextlib.suppress(ValueError):
        return signal.Signals(-code).name
    return f"signal {-code}"


def default_nodes(
    supervisor: Supervisor,
    parameters: dict[str, dict[str, object]],
    jobs: bool,
    view: bool = False,
    without: Sequence[str] = (),
) -> tuple[NodeSpec, ...]:
    """The graph for the cell that the supervisor runs, with the bag in its run directory; with
    ``view`` also the page in the browser; nodes ``without`` are left out.
    """
    merged = {name: dict(values) for name, values in parameters.items()}
    merged["recorder"] = {"output": str(supervisor.run / "bag"), **merged.get("recorder", {})}
    absent = (*without, *(() if view else ("viewer",)))
    return cell_graph(supervisor.addresses, parameters=merged, jobs=jobs, without=absent)
