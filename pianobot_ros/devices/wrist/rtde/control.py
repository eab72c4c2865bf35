"""The half of the client library that commands: its program on the controller, setpoints, stops and
the watchdog.
"""

from __future__ import annotations

import contextlib
import math
import os
import socket
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import rtde_control

from pianobot_ros.cell.errors import DeviceError
from pianobot_ros.cell.host.priority import REALTIME_PRIORITY, request_realtime, thread_ids
from pianobot_ros.devices.waiting import Waiting
from pianobot_ros.devices.wrist.rtde.watchdog import WatchdogFeed

if TYPE_CHECKING:
    from pianobot_ros.devices.wrist.config import UrConfig

__all__ = ["RTDE_PORT", "Control", "Modes"]

# A command waits, without sleeping, for what the library's receiving thread sees: that comes first.
_RECEIVE_PRIORITY = REALTIME_PRIORITY + 2
_OWN_PRIORITY = -1  # for the library: leave the scheduling of the calling thread alone
# Cycles between two packages for this interface. After each one the library looks for the next 20
# times, 0.1 ms apart; setpoints need none of them, only stops and set-up wait for their answers.
_ANSWER_CYCLES = 4
_KICK_PERIOD = 0.04  # s; the watchdog trips after 1 / watchdog_rate
_STOP_LIMIT = 1.0  # s that a stop may take before the link counts as dead
_START_LIMIT = 2.0  # s that a program may take from its upload to running
RTDE_PORT = 30004


@dataclass(frozen=True)
class Modes:
    """RTDE's ``safety_mode``, ``robot_mode`` and ``runtime_state``."""

    safety: int = 0
    robot: int = 0
    runtime: int = 0

    @property
    def can_move(self) -> bool:
        """Safety normal or reduced, and the brakes released."""
        return self.safety in (1, 2) and self.robot == 7

    @property
    def playing(self) -> bool:
        """Whether the program runs."""
        return self.runtime == 2

    @property
    def stopped(self) -> bool:
        """Whether there is no program, not even a paused one."""
        return self.runtime == 1


class Control:
    """``RTDEControlInterface`` and the program that it runs on the controller.

    Args:
        config: from ``wrist.yaml``.
        period: of the controller's cycles, s.
    """

    def __init__(self, config: UrConfig, period: float) -> None:
        self._config, self._period = config, period
        self._answer_period = _ANSWER_CYCLES * period
        self._interface: rtde_control.RTDEControlInterface | None = None
        self._watchdog = WatchdogFeed(1.0 / config.link.watchdog_rate)
        self._stopping: threading.Thread | None = None
        self._stop_lasts = Waiting(period)
        self._modes = Modes()
        self.servoing = False

    # The program.

    def start(self) -> None:
        """Start the program and tell it about hand and watchdog. Blocks for some tenths of a second
        where the connection stands, for a second where it must be made.

        Raises RuntimeError if it does not start.
        """
        if self._interface is None or not (self._interface.isConnected() and self._upload()):
            self._connect()
        control, mount = self._interface, self._config.mount
        assert control is not None
        for command, arguments in (
            (control.setTcp, ([*mount.tcp_offset, 0.0, 0.0, 0.0],)),
            (control.setPayload, (mount.payload, list(mount.payload_centre))),
            (control.setWatchdog, (self._config.link.watchdog_rate,)),
        ):
            command(*arguments)
            # The next command would wait until the program says that it is ready again, without
            # sleeping, at real-time priority.
            time.sleep(self._answer_period)
        control.kickWatchdog()
        self.servoing = False
        self._watchdog.started(time.monotonic())

    def _connect(self) -> None:
        if self._interface is not None:
            self._interface.disconnect()
            self._interface = None
        before = thread_ids()
        self._interface = rtde_control.RTDEControlInterface(
            self._config.link.host, 1.0 / self._answer_period, rt_priority=_OWN_PRIORITY
        )
        request_realtime(threads=thread_ids() - before, priority=_RECEIVE_PRIORITY)
        _send_at_once(RTDE_PORT)

    def _upload(self) -> bool:
        """Send the program again; False if it does not come up."""
        assert self._interface is not None
        # Whatever is in the command's register would be carried out by the new program. A kick
        # leaves "no command" there, also while no program runs.
        self._interface.kickWatchdog()
        if not self._interface.reuploadScript():
            return False
        deadline = time.monotonic() + _START_LIMIT
        while not self._interface.isProgramRunning():
            if time.monotonic() > deadline:
                return False
            time.sleep(self._period)
        return True

    @property
    def running(self) -> bool:
        """Whether the program runs and can be reached."""
        return (
            self._interface is not None
            and self._modes.playing
            and bool(self._interface.isConnected())
        )

    def obeys(self) -> bool:
        """Whether a command would be executed now; otherwise the library may wait for minutes."""
        return self._stopping is None and self._modes.can_move and self.running

    def look(self, modes: Modes, now: float) -> bool:
        """Take in what the controller's newest package says; True if the program has just ended
        because this process was too late with a command (see :class:`WatchdogFeed`).
        """
        self._modes = modes
        if not modes.can_move:
            self.servoing = False
        starved = self._watchdog.starved(now, playing=modes.playing, stopped=modes.stopped)
        return starved and modes.can_move and self._interface is not None

    # Motion.

    def servo(self, pose: Sequence[float]) -> bool:
        """Give the arm a tool pose (6,) for its next cycle; False if it would not obey."""
        if not self.obeys() or not all(map(math.isfinite, pose)):
            return False
        assert self._interface is not None
        servo = self._config.servo
        # Its return value says nothing: it is True on a dead link too. The echo in the state is
        # what counts.
        self._interface.servoL(list(pose), 0.5, 0.5, self._period, servo.lookahead, servo.gain)
        self.servoing = True
        self._watchdog.feed(time.monotonic())
        return True

    def stop(self) -> None:
        """Bring a streaming arm to rest; returns at once."""
        if self.servoing and self.obeys():
            assert self._interface is not None
            # The call returns when the arm is at rest, or never on a dead link. The state has to
            # flow meanwhile.
            self._stopping = threading.Thread(
                target=self._interface.servoStop,
                args=(self._config.servo.stop_deceleration,),
                daemon=True,
            )
            self._stop_lasts.begin()
            self._stopping.start()
        self.servoing = False

    def attend(self, now: float) -> None:
        """Watch a stop that is under way, and keep the controller's watchdog quiet while there is
        no stream. Raises DeviceError if the link is dead.
        """
        if self._stopping is not None:
            if not self._stopping.is_alive():
                self._stopping = None
                self._watchdog.feed(now)
            elif self._stop_lasts.turn() > _STOP_LIMIT:
                raise DeviceError(
                    f"the UR controller did not confirm a stop within {_STOP_LIMIT:g} s"
                )
        if not self.servoing and now - self._watchdog.fed > _KICK_PERIOD and self.obeys():
            assert self._interface is not None
            self._interface.kickWatchdog()
            self._watchdog.feed(time.monotonic())

    def check(self) -> None:
        """Raise DeviceError if the connection is lost."""
        if self._interface is not None and not self._interface.isConnected():
            raise DeviceError("the UR controller closed the control connection")

    def leave(self) -> None:
        """Bring the arm to rest, end the program and disconnect."""
        self.stop()
        if self._stopping is not None:
            self._stopping.join(_STOP_LIMIT)
        if self._interface is not None and self._interface.isConnected():
            if self._modes.playing:
                self._interface.stopScript()
            self._interface.disconnect()


def _send_at_once(port: int) -> None:
    """Switch Nagle's algorithm off on this process's connections to ``port`` (Linux only).

    The library leaves it on. A setpoint then waits until the controller's next package acknowledges
    the one before: a whole cycle more, in some phases of the stream, for as long as the stream
    lasts.
    """
    for entry in Path("/proc/self/fd").iterdir():
        try:
            connection = socket.socket(fileno=os.dup(int(entry.name)))
        except OSError:  # no socket, or closed meanwhile
            continue
        with connection, contextlib.suppress(OSError):
            if connection.family == socket.AF_INET and connection.getpeername()[1] == port:
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
