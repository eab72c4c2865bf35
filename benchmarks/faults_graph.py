"""The emulated cell and its graph as a user starts them, seen from outside, for
``benchmarks/faults.py``.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from numpy.typing import NDArray

from pianobot_ros.emulator.faults import FaultError, send_fault
from pianobot_ros.emulator.serving.bus import PlantBus, default_path
from pianobot_ros.nodes.graph import MODULES
from pianobot_ros.nodes.graph import NODES as ALL_NODES

NODES = [spec for spec in ALL_NODES if not spec.optional]
"""The nodes of which a cell is made; one without a viewer is whole."""

UP = ("up", "--emulated", "--no-tui", "--no-view")
READY = 240.0  # s for the first start, which compiles
LEVEL = re.compile(r"\[(?:WARN|ERROR|FATAL)\] \[(\d+\.\d+)\]")
REST = 0.005  # m/s below which the arm is at rest
STREAMS = {
    "ur5_wrist": ("/real/wrist/state", "WristState"),
    "sim_twin": ("/sim/wrist/state", "WristState"),
    "vacuum_regulator": ("/real/vacuum/state", "VacuumState"),
    "fsr_reader": ("/real/fsr", "KeyForce"),
}
"""By node the stream that says that it is back; the others say it in their diagnostics."""


def _launch(run: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "pianobot_ros.cli.app", *UP, "--run", str(run)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
        text=True,
    )


def listen(process: subprocess.Popen[str], lines: list[tuple[float, str]], only: str = "") -> None:
    """Keep the lines of a process that begin with ``only``, and when they came, monotonic s."""

    def read() -> None:
        assert process.stdout is not None
        for line in process.stdout:
            if line.startswith(only):
                lines.append((time.monotonic(), line.rstrip()))

    threading.Thread(target=read, daemon=True).start()


class RunningGraph:
    """``pianobot up --emulated`` in a process, and an observer of its graph in this one."""

    def __init__(self, run: Path) -> None:
        from pianobot_ros.nodes.watching.observer import Observer

        self.run = run
        self.lines: list[tuple[float, str]] = []
        self.knots: list[tuple[float, float]] = []  # monotonic s and speed of the wrist, m/s
        self.setpoints: list[float] = []  # stamps, s since the epoch
        self.seen: dict[str, float] = {}  # when each node's stream or diagnostics last came
        self.running = False
        self.process = _launch(run)
        listen(self.process, self.lines)
        self.observer = Observer("faults")
        self._streams = self._subscribe()
        self.family: list[psutil.Process] = []
        try:
            self._wait_ready()
        except TimeoutError:
            self.close()
            raise
        emulator = self._emulator()
        self.directory = Path(emulator[emulator.index("--directory") + 1])
        self.bus = PlantBus.attach(default_path(emulator[emulator.index("--name") + 1]))
        self._knot = self.bus.read_wrist().next_index
        self.family = psutil.Process(self.process.pid).children(recursive=True)

    def _wait_ready(self) -> None:
        def ready() -> bool:
            if self.process.poll() is not None:
                raise TimeoutError(f"the graph ended: {self.lines[-1][1] if self.lines else ''}")
            return self.said("ready; Ctrl-C")

        self.wait(ready, READY, "the graph")
        self.wait(self.healthy, 30.0, "healthy nodes")

    def _subscribe(self) -> dict[str, Any]:
        from diagnostic_msgs.msg import DiagnosticArray
        from pianobot_msgs import msg

        from pianobot_ros.nodes.topics.polled import PolledSubscription, stream_qos

        node = self.observer.node
        streams = {
            name: PolledSubscription(node, getattr(msg, kind), topic, stream_qos(500))
            for name, (topic, kind) in STREAMS.items()
        }
        streams["command"] = PolledSubscription(
            node, msg.WristCommand, "/command/wrist", stream_qos(1000, reliable=True)
        )

        def on_diagnostics(array: DiagnosticArray) -> None:
            for status in array.status:
                name = status.name.partition(": ")[0]
                if name not in STREAMS and status.level != b"\x02":
                    self.seen[name] = time.monotonic()

        node.create_subscription(DiagnosticArray, "/diagnostics", on_diagnostics, 50)
        return streams

    # What can be seen.

    def turn(self) -> None:
        """Let messages in for a hundredth of a second, and follow the arm."""
        from rclpy.serialization import deserialize_message

        self.observer.spin(0.01)
        behind = time.monotonic() - time.time()
        for name, stream in self._streams.items():
            if not (taken := stream.take()):
                continue
            if name == "command":
                self.setpoints += [_stamp(one.data) for one in taken]
                continue
            if name == "ur5_wrist":
                self.running = deserialize_message(taken[-1].data, stream.kind).program_running
                if not self.running:
                    continue
            self.seen[name] = 1e-9 * taken[-1].sent + behind
        if hasattr(self, "bus"):
            found = self.bus.read_wrist(self._knot)
            self._knot = found.next_index
            speed: NDArray[np.float64] = np.linalg.norm(found.twist[:, :3], axis=1)
            self.knots += list(zip(found.time.tolist(), speed.tolist(), strict=True))

    def wait(self, condition: Callable[[], Any], limit: float, what: str) -> Any:
        """Turn until the condition holds; raises :class:`TimeoutError` with ``what``."""
        end = time.monotonic() + limit
        while not (value := condition()):
            if time.monotonic() > end:
                raise TimeoutError(f"{what}: not within {limit:g} s")
            self.turn()
        return value

    def time_of(self, words: str, since: float = 0.0) -> float:
        """When the supervisor said this, monotonic s; infinite if it has not."""
        return next((t for t, line in self.lines if t >= since and words in line), math.inf)

    def said(self, words: str) -> bool:
        """Whether the supervisor has said this."""
        return math.isfinite(self.time_of(words))

    def healthy(self) -> bool:
        """Whether every node reports itself, none with an error, and phrases can be played."""
        states = self.observer.states()
        return self.observer.conductor_ready() and all(
            states.get(spec.name, ("", ""))[0] in ("ok", "warning") for spec in NODES
        )

    def node(self, name: str) -> psutil.Process | None:
        """The living process of a node."""
        for child in psutil.Process(self.process.pid).children():
            with contextlib.suppress(psutil.NoSuchProcess):
                words = child.cmdline()
                if MODULES[name] in words and child.status() != "zombie":
                    return child
        return None

    def _emulator(self) -> list[str]:
        for child in psutil.Process(self.process.pid).children():
            if "pianobot_ros.emulator" in (words := child.cmdline()):
                return list(words)
        raise TimeoutError("no emulated cell")

    def logged(self, since: float) -> list[tuple[float, str]]:
        """Warnings and errors in the nodes' logs since a monotonic time, with their own times."""
        behind = time.monotonic() - time.time()
        found = []
        for path in (self.run / "log").glob("*.log"):
            for line in path.read_text(errors="replace").splitlines():
                if (match := LEVEL.search(line)) and float(match[1]) + behind >= since:
                    found.append((float(match[1]) + behind, f"{path.stem}: {line[match.end() :]}"))
        return sorted(found)

    def rest(self, since: float) -> float | None:
        """When the arm came to rest, monotonic s: the first time since then from which it stands
        still for 0.1 s. None if it did not.
        """
        begun = None
        for t, speed in self.knots:
            if t < since:
                continue
            if speed > REST:
                begun = None
            elif begun is None:
                begun = t
            elif t - begun > 0.1:
                return begun
        return None

    def sounding(self) -> bool:
        """Whether a note sounds on the emulated piano."""
        with contextlib.suppress(FaultError, ValueError, OSError):
            return bool(json.loads(self.fault("midi", "status"))["sounding"])
        return False

    # What can be done.

    def fault(self, device: str, command: str) -> str:
        """Send a fault to an emulated device."""
        return send_fault(f"unix:{self.directory}/{device}.ctl", command)

    def recover(self) -> None:
        """What a user does after a stop: release the arm's program."""
        self.observer.recover_arm()

    def start(self, phrase: str) -> Any:
        """Start a phrase; returns the future of its result."""
        from pianobot_msgs.action import PlayPhrase

        accepted = self.observer.send(PlayPhrase.Goal(phrase_yaml=phrase))
        self.wait(accepted.done, 20.0, "the conductor's answer")
        if not accepted.result().accepted:
            raise TimeoutError("the phrase was refused")
        return accepted.result().get_result_async()

    def close(self) -> None:
        """End everything that was started."""
        with contextlib.suppress(psutil.NoSuchProcess):
            self.family += psutil.Process(self.process.pid).children(recursive=True)
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGCONT)
            self.process.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.process.wait(30)
        for child in self.family:
            with contextlib.suppress(psutil.NoSuchProcess):
                child.kill()
        with contextlib.suppress(ProcessLookupError):
            self.process.kill()
        self.process.wait(5)
        if hasattr(self, "bus"):
            self.bus.close()
        self.observer.close()


def _stamp(data: bytes) -> float:
    """Stamp of a serialized message, s since the epoch."""
    return int.from_bytes(data[4:8], "little") + 1e-9 * int.from_bytes(data[8:12], "little")
