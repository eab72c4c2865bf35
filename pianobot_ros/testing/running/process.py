"""Processes of a test: none of them, nor any of their children, outlives it."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import psutil

import pianobot_ros
from pianobot_ros.cell.host.closing import Closing
from pianobot_ros.nodes.graph import MODULES, ros_arguments
from pianobot_ros.testing.waiting import TIMEOUT, wait_for

__all__ = ["Process", "Processes"]

T = TypeVar("T")
_PATIENCE = 3.0  # s that a process may take to end before it is killed
_TAIL = 15  # lines of a process's output in a failure
_LONG_TAIL = 80  # the same with the stacks of its threads


class Process(subprocess.Popen[bytes]):
    """A process whose output goes to a file. An end that nobody asked for is :meth:`trouble`."""

    def __init__(self, command: list[str], log: Path, **options: Any) -> None:
        self.log = log
        self._asked = False  # to end
        with log.open("wb") as output:
            super().__init__(
                command,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                **options,
            )

    def output(self) -> str:
        """What it has written so far."""
        return self.log.read_text(errors="replace")

    def send_signal(self, sig: int) -> None:
        """As ``Popen``; an end by this signal is no trouble."""
        self._asked |= sig not in (signal.SIGSTOP, signal.SIGCONT)
        super().send_signal(sig)

    def wait(self, timeout: float | None = None) -> int:
        """As ``Popen``; whoever waits for the end expects it."""
        self._asked = True
        return super().wait(timeout)

    def end(self, number: int = signal.SIGINT, timeout: float = TIMEOUT) -> int:
        """Send a signal and wait for the end; returns the exit code. Raises AssertionError, with
        what the process said and where its threads stood, if it does not end.
        """
        self.send_signal(number)
        try:
            return self.wait(timeout)
        except subprocess.TimeoutExpired:
            self.abort()
            words = "\n".join(self.output().splitlines()[-_LONG_TAIL:])
            message = f"{self.log.stem} did not end within {timeout:g} s:\n{words}"
            raise AssertionError(message) from None

    def abort(self) -> None:
        """End it at once; a Python process then writes where its threads stand."""
        self.send_signal(signal.SIGABRT)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.wait(_PATIENCE)

    def family(self) -> list[psutil.Process]:
        """Its living descendants."""
        with contextlib.suppress(psutil.NoSuchProcess):
            return list(psutil.Process(self.pid).children(recursive=True))
        return []

    def trouble(self) -> str:
        """Why this process is of no use any more: an empty string while it runs or was told to
        end.
        """
        if self._asked or self.poll() is None:
            return ""
        words = "\n".join(self.output().splitlines()[-_TAIL:])
        return f"{self.log.stem} has ended with code {self.returncode}:\n{words}"

    def close(self) -> None:
        """End it and everything that it has started, politely at first. Safe to call twice."""
        family = self.family()
        if self.poll() is None:
            self.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.wait(_PATIENCE)
        if self.poll() is None:
            self.kill()
            self.wait()
        for child in family:
            with contextlib.suppress(psutil.NoSuchProcess):
                child.kill()


class Processes(Closing):
    """Starts processes, with their output in files of one folder, and ends them all.

    Args:
        folder: for the logs.
        environment: variables of every process, beside those of this one.
    """

    def __init__(self, folder: Path, environment: Mapping[str, str] | None = None) -> None:
        self.folder = folder
        self._environment = dict(environment or {})
        self._started: list[Process] = []

    def start(
        self, *command: str, log: str = "", env: Mapping[str, str] | None = None, **options: Any
    ) -> Process:
        """Start a command.

        Args:
            command: its words.
            log: name of the file with its output, without ``.log``.
            env: more variables for this one.
            options: for ``subprocess.Popen``.
        """
        name = log or f"process{len(self._started)}"
        fixed = {"PYTHONUNBUFFERED": "1", "PYTHONFAULTHANDLER": "1", "PYTHONPATH": _path()}
        environment = {**os.environ, **fixed, **self._environment, **(env or {})}
        process = Process(list(command), self.folder / f"{name}.log", env=environment, **options)
        self._started.append(process)
        return process

    def python(self, module: str, *arguments: str, log: str = "", **options: Any) -> Process:
        """Start ``python -m module`` with this Python and its search path."""
        name = log or module.rsplit(".", 1)[-1]
        return self.start(sys.executable, "-m", module, *arguments, log=name, **options)

    def node(self, name: str, log: str = "", **parameters: Any) -> Process:
        """Start one of the nodes of pianobot, by the name of its executable."""
        return self.python(MODULES[name], *ros_arguments(parameters), log=log or name)

    def output(self, log: str) -> str:
        """What the process with this log has written so far."""
        return (self.folder / f"{log}.log").read_text(errors="replace")

    def trouble(self) -> str:
        """What the first process that ended unasked has to say; empty if none has."""
        return next((said for p in self._started if (said := p.trouble())), "")

    def wait_for(
        self,
        condition: Callable[[], T],
        what: str | Callable[[], str] = "",
        timeout: float = TIMEOUT,
    ) -> T:
        """:func:`wait_for`, which fails at once when a process has ended unasked."""
        return wait_for(condition, what, timeout, trouble=self.trouble)

    def close(self) -> None:
        """End whatever is left, the last started first."""
        while self._started:
            self._started.pop().close()


def _path() -> str:
    """Children find the same pianobot_ros as this process, wherever they run."""
    here = str(Path(pianobot_ros.__file__).resolve().parents[1])
    return os.pathsep.join([here, os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
