"""Starts the emulated UR as a process of its own, for tests and benchmarks."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import random
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from pianobot_ros.cell.host.closing import wait_or_kill
from pianobot_ros.cell.host.priority import request_realtime
from pianobot_ros.emulator.faults import FaultError, send_fault
from pianobot_ros.emulator.wrist.motion.kinematics import Array

__all__ = ["EmulatedUr", "loopback_address"]

_START_LIMIT = 300.0  # s, on a busy machine; one that ends is noticed at once
_counter = itertools.count(1)


def loopback_address() -> str:
    """A loopback address that no other emulated robot of this machine is likely to use."""
    # 127.0.x.x is left to robots with addresses chosen by hand.
    return f"127.{1 + os.getpid() % 250}.{random.randint(1, 254)}.{next(_counter) % 250 + 1}"


class EmulatedUr:
    """A running emulated controller; a context manager that ends it.

    Args:
        model: ``cb3`` or ``e-series``.
        directory: where its control socket and its motion log go.
        host: loopback address; a free one if None.
        unlock_delay: s after which a protective stop can be unlocked.
    """

    def __init__(
        self,
        directory: Path,
        model: str = "cb3",
        host: str | None = None,
        unlock_delay: float = 0.5,
    ) -> None:
        self.host = host or loopback_address()
        self.log = directory / f"ur-{self.host}.csv"
        self.endpoint = f"unix:{directory / f'wrist-{self.host}.ctl'}"
        self._command = [
            *(
                sys.executable,
                "-m",
                "pianobot_ros.emulator.wrist",
                "--host",
                self.host,
                "--model",
                model,
            ),
            *("--faults", self.endpoint, "--log", str(self.log)),
            *("--unlock-delay", str(unlock_delay), "--power-time", "0.3"),
        ]
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start it and wait until it serves."""
        self._process = subprocess.Popen(
            self._command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        deadline = time.monotonic() + _START_LIMIT
        while True:
            with contextlib.suppress(FaultError):
                self.fault("status")
                request_realtime(self._process.pid)  # a real arm waits for nobody
                return
            if self._process.poll() is not None:
                raise RuntimeError(
                    f"the emulated UR at {self.host} ended with code {self._process.returncode}"
                )
            if time.monotonic() > deadline:
                self.end()
                raise RuntimeError(
                    f"the emulated UR at {self.host} did not start within {_START_LIMIT:g} s"
                )
            time.sleep(0.05)

    def end(self) -> None:
        """End it, and wait until it has."""
        if self._process is not None:
            self._process.terminate()
            wait_or_kill(self._process, 5.0)
            self._process = None

    def kill(self) -> None:
        """Let it die without a word."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None

    def fault(self, command: str) -> str:
        """Send a fault command; returns the answer."""
        return send_fault(self.endpoint, command)

    def status(self) -> dict[str, Any]:
        """What the controller is doing."""
        return dict(json.loads(self.fault("status")))

    def motion(self) -> tuple[Array, Array, Array, list[str]]:
        """The motion so far: time (n,) s monotonic, wrist position (n, 3) m, velocity (n, 3) m/s,
        and mode.
        """
        rows = [line.split(",") for line in self.log.read_text().splitlines()[1:]]
        rows = [row for row in rows if len(row) == 12]  # the last line may be half written
        numbers = np.array(
            [[float(value) for value in (row[0], *row[6:])] for row in rows]
        ).reshape(-1, 7)
        return numbers[:, 0], numbers[:, 1:4], numbers[:, 4:7], [row[1] for row in rows]

    def __enter__(self) -> EmulatedUr:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.end()
