"""Starts the worker process, watches it, and starts another when it is lost or hangs."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from pianobot_ros.cell.host.marks import Mark
from pianobot_ros.devices.attended import Attended
from pianobot_ros.devices.base import DeviceUnavailableError, HealthLevel
from pianobot_ros.devices.waiting import Waiting
from pianobot_ros.devices.wrist.config import UrConfig
from pianobot_ros.devices.wrist.messages import QUIT, READING, RawReading, unpack_text

__all__ = ["WorkerSupervisor"]

_TURN = 0.1  # s for which the worker is listened to at a time
_RETRY_PERIOD = 0.5  # s between the loss of a link and the next attempt
_LOAD_LIMIT = 60.0  # s that the process may take until it runs; a busy machine takes its time
_LEAVE_LIMIT = 2.0  # s that an orderly end may take: brake, end the program, disconnect


class WorkerSupervisor:
    """Owns the worker process of one arm.

    Args:
        config: handed to the worker.
        on_reading: called with every package, on the supervisor's thread.
        on_event: called with (severity, text) when the link is lost or comes back, on the
            supervisor's thread.
        ended: that the program was ended while somebody looked: it is not started unasked.
    """

    def __init__(
        self,
        config: UrConfig,
        on_reading: Callable[[RawReading], None],
        on_event: Callable[[HealthLevel, str], None],
        ended: Mark,
    ) -> None:
        self._config, self._ended = config, ended
        self._on_reading, self._on_event = on_reading, on_event
        self._thread: Attended | None = None
        self._channel: socket.socket | None = None
        self._closing = threading.Event()
        self._settled = threading.Event()  # the first attempt has succeeded or failed
        self._request: tuple[float, Callable[[bool, str], None]] | None = None
        self._request_lock = threading.Lock()
        self._said = ""
        self.ready = False
        self.problem = ""
        self.restarts = 0
        self.rate, self.version = 125.0, ""
        self.pid: int | None = None

    def start(self) -> None:
        """Begin; returns at once."""
        if self._thread is None:
            self._closing.clear()
            self._settled.clear()
            self._thread = Attended(self._run, "ur supervisor", self._fault)
            self._thread.start()

    def wait_ready(self) -> None:
        """Wait for the first attempt to succeed. Raises DeviceUnavailableError with its problem."""
        self._settled.wait()
        if not self.ready:
            raise DeviceUnavailableError(self.problem)

    def stop(self) -> None:
        """End the worker in order, or by force if it takes too long."""
        self._closing.set()
        self.send(QUIT)
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def send(self, message: bytes) -> bool:
        """Hand a message to the worker without waiting; False if there is none or it does not
        read.
        """
        channel = self._channel
        if channel is None:
            return False
        try:
            channel.send(message, socket.MSG_DONTWAIT)
        except OSError:
            return False
        return True

    def request(self, message: bytes, done: Callable[[bool, str], None], limit: float) -> bool:
        """Send a message that the worker answers; ``done`` gets the answer once. False if it could
        not be sent.
        """
        with self._request_lock:
            if self._request is not None:
                done(False, "another recovery is under way")
                return True
            self._request = (time.monotonic() + limit, done)
        if not self.ready or not self.send(message):
            with self._request_lock:
                self._request = None
            return False
        return True

    # The supervisor's thread.

    def _fault(self, text: str) -> None:
        self.ready = False
        self.problem = self._said = f"internal error: {text}"
        self._answer(False, self.problem)
        self._on_event(HealthLevel.ERROR, self.problem)

    def _run(self) -> None:
        while not self._closing.is_set():
            problem = self._attempt()
            self.ready = False
            self._answer(False, problem)
            if self._closing.is_set():
                break
            self.problem = problem
            if problem != self._said:  # a missing robot is reported once, not at every attempt
                self._said = problem
                self._on_event(HealthLevel.ERROR, problem)
            self._settled.set()
            self.restarts += 1
            self._closing.wait(_RETRY_PERIOD)
        self._settled.set()

    def _attempt(self) -> str:
        """One worker from start to end; returns why it ended."""
        process, ours = _start_worker(self._config, not self._ended)
        self.pid = process.pid
        self._channel = ours
        try:
            return self._listen(ours)
        finally:
            self._channel = None
            ours.close()
            self.pid = None
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(0.2)
            if process.poll() is None:
                process.kill()
                process.wait()

    def _listen(self, channel: socket.socket) -> str:
        link = self._config.link
        hang = max(1.0, 5.0 * link.state_timeout)
        waiting, limit = Waiting(2.0 * _TURN), _LOAD_LIMIT
        leaving = False
        problem = (
            f"the UR controller at {link.host} did not come up within {link.connect_timeout:g} s"
        )
        while True:
            waited = waiting.turn()
            if self._closing.is_set() and not leaving:
                leaving, limit = True, min(limit, waited + _LEAVE_LIMIT)
                self.send(QUIT)
            if waited > limit:
                return problem
            channel.settimeout(_TURN)
            self._expire_request(time.monotonic())
            try:
                message = channel.recv(4096)
            except TimeoutError:
                continue
            except OSError:
                message = b""
            if not message:
                return problem
            if message[:1] == READING:
                reading = RawReading.unpack(message)
                self._ended.set(not reading.program_running)
                self._on_reading(reading)
                patience = hang if self.ready else 0.0
            else:
                content = unpack_text(message)
                patience = content.get("seconds", 0.0)
                problem = self._take_event(content) or problem
                if content["event"] == "ready":
                    patience = hang
            if patience and not leaving:
                waiting.begin()
                limit = patience

    def _take_event(self, content: dict[str, Any]) -> str | None:
        """React to an event; returns what the problem is if the worker ends now."""
        event = content["event"]
        if event == "lost":
            return str(content["message"])
        if event == "note":
            self._on_event(HealthLevel.WARN, str(content["message"]))
        if event == "ready":
            self._become_ready(content)
            return (
                f"the driver's process for the UR controller at {self._config.link.host} hung or"
                " crashed"
            )
        if event == "recovered":
            self._answer(bool(content["ok"]), str(content["message"]))
        return None

    def _become_ready(self, content: dict[str, Any]) -> None:
        self.rate, self.version = float(content["rate"]), str(content["version"])
        if self._said:
            self._on_event(
                HealthLevel.OK, f"link to the UR controller at {self._config.link.host} is back"
            )
        self._said = self.problem = ""
        self.ready = True
        self._settled.set()

    def _answer(self, ok: bool, message: str) -> None:
        with self._request_lock:
            request, self._request = self._request, None
        if request is not None:
            request[1](ok, message)

    def _expire_request(self, now: float) -> None:
        if self._request is not None and now > self._request[0]:
            self._answer(False, "recovery took too long: look at the pendant")


def _start_worker(
    config: UrConfig, starts_program: bool
) -> tuple[subprocess.Popen[bytes], socket.socket]:
    """The worker's process, and our end of the channel to it."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    command = [sys.executable, "-m", "pianobot_ros.devices.wrist.rtde.worker"]
    command += [str(theirs.fileno()), str(os.getpid())]
    # The library prints its own progress on stdout and its complaints on stderr: neither says more
    # than we do.
    process = subprocess.Popen(
        [*command, config.model_dump_json(), str(int(starts_program))],
        pass_fds=[theirs.fileno()],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=None if os.environ.get("PIANOBOT_UR_VERBOSE") else subprocess.DEVNULL,
    )
    theirs.close()
    return process, ours
