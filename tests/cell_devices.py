"""Emulated serial devices and piano as processes, for the tests of drivers and nodes."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any

from pianobot_ros.emulator.faults import send_fault

ROOT = Path(__file__).resolve().parents[1]


def until(condition: Callable[[], Any], what: str, limit: float = 30.0) -> Any:
    """Wait for a condition; returns its value."""
    deadline = time.monotonic() + limit
    while not (value := condition()):
        assert time.monotonic() < deadline, f"never happened: {what}"
        time.sleep(0.005)
    return value


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def environment(**extra: str) -> dict[str, str]:
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
    return {**os.environ, "PYTHONPATH": path, **extra}


class Device:
    """A process of the emulated cell with its control socket; ready when the constructor returns."""

    def __init__(self, module: str, directory: Path, *arguments: str, **extra: str) -> None:
        self.endpoint = f"unix:{directory / (module + '.ctl')}"
        self.process = subprocess.Popen(
            [sys.executable, "-m", f"pianobot_ros.emulator.{module}", "--faults", self.endpoint, *arguments],
            env=environment(**extra),
            stderr=subprocess.PIPE,
            text=True,
        )
        assert self.process.stderr is not None
        line = self.process.stderr.readline()
        assert "ready" in line, line

    def fault(self, command: str) -> str:
        return send_fault(self.endpoint, command)

    def status(self) -> dict[str, Any]:
        return dict(json.loads(self.fault("status")))

    def close(self) -> None:
        self.process.terminate()
        try:
            self.process.wait(5.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        if self.process.stderr:
            self.process.stderr.close()

    def __enter__(self) -> Device:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
