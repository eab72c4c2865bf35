"""What every test may use: isolation of ROS graphs, processes that never outlive a test, and waiting on conditions."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import psutil
import pytest

from pianobot_ros.nodes.discovery import RANGE, discovery

T = TypeVar("T")

ROOT = Path(__file__).resolve().parents[1]

# Before any context: the middleware reads its settings once in a process. Children inherit them.
os.environ[RANGE] = "LOCALHOST"
os.environ.update(discovery())


def wait_until(condition: Callable[[], T], deadline: float = 30.0, what: str = "", poll: float = 0.01) -> T:
    """The first true value of ``condition``, asked again and again for at most ``deadline`` s. Fails with ``what``."""
    end = time.monotonic() + deadline
    while True:
        value = condition()
        if value:
            return value
        if time.monotonic() >= end:
            pytest.fail(f"not within {deadline:g} s: {what or getattr(condition, '__name__', 'the condition')}")
        time.sleep(poll)


@pytest.fixture(name="wait_until")
def _wait_until() -> Callable[..., Any]:
    return wait_until


@pytest.fixture
def ros_domain(monkeypatch: pytest.MonkeyPatch) -> int:
    """A ROS domain that no other test uses at the same time; also in the environment of children.

    Domains 1 to 100 keep the ports below Linux' ephemeral range.
    """
    worker = os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")
    seed = f"{os.getpid()}-{worker}-{time.monotonic_ns()}"
    domain = random.Random(seed).randint(1, 100)
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    return domain


@dataclass
class Ros:
    """A ROS context of one test: nodes made here are spun together and destroyed at its end."""

    context: Any
    executor: Any
    domain: int
    nodes: list[Any] = field(default_factory=list)

    def add(self, node: Any) -> Any:
        """Spin ``node`` with the others and destroy it at the end."""
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    def node(self, name: str, **options: Any) -> Any:
        """A plain node for the test's own publishers and subscribers."""
        from rclpy.node import Node

        return self.add(Node(name, context=self.context, **options))

    def spin_until(self, condition: Callable[[], T], deadline: float = 30.0, what: str = "") -> T:
        """Spin until ``condition`` is true; fails with ``what`` after ``deadline`` s."""

        def turn() -> T:
            self.executor.spin_once(timeout_sec=0.01)
            return condition()

        return wait_until(turn, deadline, what, poll=0.0)

    def wait_for(self, future: Any, deadline: float = 30.0, what: str = "an answer") -> Any:
        """The result of a future."""
        self.spin_until(future.done, deadline, what)
        return future.result()

    def collect(self, kind: Any, topic: str, qos: Any = 100) -> list[Any]:
        """A list that fills with the messages of ``topic``."""
        if not self.nodes:
            self.node("test")
        received: list[Any] = []
        self.nodes[0].create_subscription(kind, topic, received.append, qos)
        return received

    def arm(self, safety: int = 1, hears: bool = True) -> None:
        """A real arm at home that takes setpoints as its target, unless it does not hear them, and says so 20 times a second."""
        from pianobot_msgs.msg import WristCommand, WristState

        from pianobot_ros.cell.limits import wrist_limits
        from pianobot_ros.nodes import common

        node = self.node("arm")
        states = node.create_publisher(WristState, "/real/wrist/state", common.SENSOR_QOS)
        state = WristState(safety_state=safety)
        place = state.pose.position
        place.x, place.y, place.z = wrist_limits().home
        state.pose.orientation.w = 1.0
        state.target_pose = state.pose

        def obey(command: WristCommand) -> None:
            state.target_pose = command.pose

        if hears:
            node.create_subscription(WristCommand, "/command/wrist", obey, 10)
        node.create_timer(0.05, lambda: states.publish(state))


@pytest.fixture
def ros(ros_domain: int) -> Iterator[Ros]:
    """An isolated ROS context with a single-threaded executor."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.signals import SignalHandlerOptions

    context = rclpy.Context()
    rclpy.init(context=context, domain_id=ros_domain, signal_handler_options=SignalHandlerOptions.NO)
    executor = SingleThreadedExecutor(context=context)
    made = Ros(context, executor, ros_domain)
    yield made
    for node in made.nodes:
        executor.remove_node(node)
        with contextlib.suppress(Exception):
            node.destroy_node()
    executor.shutdown(timeout_sec=1.0)
    rclpy.try_shutdown(context=context)


class Processes:
    """Starts processes and makes sure that none of them, nor any of their children, outlives the test."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._started: list[subprocess.Popen[bytes]] = []

    def start(self, *command: str, log: str | None = None, **options: Any) -> subprocess.Popen[bytes]:
        """Start ``command`` in its own session, output to ``<log>.log`` in the test's folder."""
        name = log or f"process{len(self._started)}"
        environment = {**os.environ, "PYTHONUNBUFFERED": "1", **options.pop("env", {})}
        with (self.folder / f"{name}.log").open("wb") as output:
            process = subprocess.Popen(
                command, stdout=output, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, start_new_session=True,
                env=environment, cwd=options.pop("cwd", ROOT), **options,
            )  # fmt: skip
        self._started.append(process)
        return process

    def python(self, module: str, *arguments: str, log: str | None = None, **options: Any) -> subprocess.Popen[bytes]:
        """Start ``python -m module``."""
        return self.start(sys.executable, "-m", module, *arguments, log=log or module.rsplit(".", 1)[-1], **options)

    def output(self, log: str) -> str:
        """What the process ``log`` has written so far."""
        return (self.folder / f"{log}.log").read_text(errors="replace")

    def end(self, process: subprocess.Popen[bytes], number: int = signal.SIGINT, deadline: float = 30.0) -> int:
        """Signal a process and wait for its end; returns its exit code."""
        process.send_signal(number)
        return process.wait(deadline)

    def close(self) -> None:
        """Kill whatever is left, with all descendants."""
        for process in self._started:
            family: Sequence[psutil.Process] = ()
            with contextlib.suppress(psutil.NoSuchProcess):
                family = psutil.Process(process.pid).children(recursive=True)
            if process.poll() is None:
                process.terminate()
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(3.0)
            if process.poll() is None:
                process.kill()
                process.wait(3.0)
            for child in family:
                with contextlib.suppress(psutil.NoSuchProcess):
                    child.kill()


@pytest.fixture
def processes(tmp_path: Path) -> Iterator[Processes]:
    """A :class:`Processes` that cleans up at the end of the test."""
    made = Processes(tmp_path)
    yield made
    made.close()
