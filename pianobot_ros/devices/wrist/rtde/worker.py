"""The process that holds the client library ``ur_rtde``.

It lives apart from the node because the library's constructor can wait for ever with the
interpreter locked, because calls hang when the controller is gone, and because its own reconnection
can crash. Its parent watches it and kills it.

Started as ``python -m pianobot_ros.devices.wrist.rtde.worker FD PARENT CONFIG`` with one end of a
socket pair, the parent's process id and the configuration as JSON. When the link is lost it says so
and exits; the parent starts another. What it imports is little, so that another is there soon, also
on a busy machine.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import json
import math
import os
import select
import signal
import socket
import sys
import time
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import dashboard_client

from pianobot_ros.cell.errors import DeviceError
from pianobot_ros.cell.host.priority import request_realtime
from pianobot_ros.cell.host.wall_clock import WallClock
from pianobot_ros.devices.waiting import Waiting
from pianobot_ros.devices.wrist.limits.reach import Reach
from pianobot_ros.devices.wrist.messages import (
    HALT,
    QUIT,
    RECOVER,
    SETPOINT,
    Setpoint,
    pack_text,
)
from pianobot_ros.devices.wrist.rtde.control import Control, Modes
from pianobot_ros.devices.wrist.rtde.echo import Echo
from pianobot_ros.devices.wrist.rtde.probe import probe
from pianobot_ros.devices.wrist.rtde.receive import StateReceiver
from pianobot_ros.devices.wrist.rtde.recovery import Recovery
from pianobot_ros.devices.wrist.rtde.setpoint_stream import CycleClock, SetpointStream

if TYPE_CHECKING:
    from pianobot_ros.devices.wrist.config import UrConfig

__all__ = ["main"]

# s that starting the program may take, the library's own limit for its upload included
_SET_UP_TIME = 8.0
_TRIPPED = "the watchdog tripped because this machine was busy; program restarted"


class Worker:
    """The link to one controller, which ``starts_program`` or leaves it as it is until a recovery:
    somebody may have ended it at the pendant.
    """

    def __init__(self, channel: socket.socket, config: UrConfig, starts_program: bool) -> None:
        self._channel, self._config = channel, config
        self._starts_program = starts_program
        self._receive: StateReceiver | None = None
        self._applied = 0
        self._heard = -math.inf  # when a setpoint came last, monotonic s
        self._setpoint: Setpoint | None = None  # the one that the arm was last given
        self._silence = Waiting(0.0)
        self._stream, self._clock, self._wall = SetpointStream(), CycleClock(), WallClock()
        self._echo = Echo()
        self._recovery: Recovery | None = None
        self._greeting = b""
        self.period = 0.008
        self._control = Control(config, self.period)
        self._reach = Reach(config.limits, self.period)

    # Link.

    def connect(self) -> None:
        """Find the controller, receive its state, and start the control program if the arm can
        move.
        """
        link = self._config.link
        self._send(pack_text("busy", seconds=link.connect_timeout))  # from here, not from the start
        probe(link.host)
        dashboard = self._dashboard()
        version = dashboard.polyscopeVersion()
        dashboard.disconnect()
        rate = _rate(version, link.rate)
        self.period = 1.0 / rate
        self._control = Control(self._config, self.period)
        self._reach = Reach(self._config.limits, self.period)
        self._receive = StateReceiver(link.host, rate)
        if self._starts_program and self._receive.modes.can_move:
            self._start_program()
        self._greeting = pack_text("ready", rate=rate, version=version)

    def _start_program(self) -> None:
        """Raises RuntimeError if the program does not start."""
        self._send(pack_text("busy", seconds=_SET_UP_TIME))
        self._control.start()

    def _dashboard(self) -> dashboard_client.DashboardClient:
        dashboard = dashboard_client.DashboardClient(self._config.link.host)
        dashboard.connect()
        return dashboard

    # Loop.

    def run(self) -> None:
        """Serve until told to quit. Raises DeviceError when the link is lost."""
        assert self._receive is not None
        receive, channel = self._receive, self._channel
        sources: list[socket.socket | StateReceiver] = [channel, receive]
        self._silence = Waiting(self.period)
        while True:
            wait = self.period
            if self._control.servoing:
                wait = min(wait, max(0.0, self._stale_at() - time.monotonic()))
            readable, _, _ = select.select(sources, [], [], wait)
            if channel in readable and not self._take_orders():
                return
            came = receive in readable and receive.receive()
            now = time.monotonic()  # noticed never before it came
            if came:
                cycle = self._clock.read(now, receive.stamp)
                self._follow(cycle)
                self._package(now, cycle)
            self._check_link()
            if self._control.servoing and now >= self._stale_at():
                self._stop()
            self._control.attend(now)

    def _stale_at(self) -> float:
        """When the arm is to be stopped if no more setpoints come, monotonic s. Of a stream that is
        ahead what is not sent yet is no less fresh for a package that the controller sends late.
        """
        return max(self._heard, self._stream.end) + self._config.limits.stale

    def _take_orders(self) -> bool:
        """Read everything that waits; of several setpoints that are due only the newest counts.
        False to quit.
        """
        setpoint: Setpoint | None = None
        soon = time.monotonic() + 0.5 * self.period
        while True:
            try:
                message = self._channel.recv(4096, socket.MSG_DONTWAIT)
            except BlockingIOError:
                break
            kind = message[:1]
            if kind in (b"", QUIT):
                return False
            if kind == SETPOINT:
                newest, self._heard = Setpoint.unpack(message), time.monotonic()
                if self._stream or newest.due > soon:  # sent in the controller's cycles
                    self._stream.add(newest)  # from here on, see _follow
                else:
                    setpoint = newest
                    self._reach.ask(newest.pose, newest.due)
            elif kind == HALT:
                setpoint = None
                self._stop()
            elif kind == RECOVER:
                self._recovery = Recovery(self._dashboard, self._start_program, time.monotonic())
        if setpoint is not None:
            self._servo(setpoint)
        return True

    def _follow(self, cycle: float) -> None:
        """Send what of the stream is for the controller's next cycle, or what it is still short of
        the last setpoint; ``cycle`` is the monotonic time of the present one.
        """
        if not self._stream:
            if self._setpoint is not None and self._control.servoing and self._reach.short:
                self._servo(self._setpoint)
            return
        ahead = cycle + self._config.servo.ahead * self.period
        setpoint = self._stream.follow(ahead, self.period)
        if setpoint is not None:
            self._reach.ask(setpoint.pose, self._stream.given)
            self._servo(setpoint)
        if ahead > self._stream.end + self._config.limits.stale:
            self._stop()

    def _servo(self, setpoint: Setpoint) -> None:
        """Give the arm what was asked for last, of this setpoint, as far as the limits allow."""
        if (receive := self._receive) is None or not self._control.obeys():
            return
        if not self._control.servoing:
            self._reach.rest(receive.target)
        pose = self._reach.give(time.monotonic(), self._clock.newest)
        self._setpoint = setpoint._replace(pose=pose)
        if self._control.servo(self._setpoint.pose):
            self._applied = setpoint.sequence
            self._echo.sent(self._setpoint)

    def _stop(self) -> None:
        self._stream.clear()
        self._control.stop()
        self._echo.clear()

    def _check_link(self) -> None:
        silent = self._silence.turn()
        if silent > self._config.link.state_timeout:
            raise DeviceError(f"the UR controller has been silent for {silent:.2f} s")
        self._control.check()

    def _package(self, now: float, cycle: float) -> None:
        """Hand a package on that was noticed at ``now``; its ``cycle`` began before. Both
        monotonic, s.
        """
        receive = self._receive
        assert receive is not None
        self._silence.begin()
        modes = receive.read_modes()
        starved = self._control.look(modes, now)
        reading = receive.reading(
            now,
            self._wall.wall_ns(cycle),
            applied=self._applied,
            latency=self._echo.latency(receive.target, now),
            behind=max(self._stream.behind, self._reach.lag if self._control.servoing else 0.0),
            servoing=self._control.servoing,
        )
        self._send(reading.pack())
        if self._greeting:
            self._send(self._greeting)  # the parent learns that the link is up when it has a state
            self._greeting = b""
        if self._recovery is not None:
            self._recover(now, modes)
        elif starved:
            self._send(pack_text("note", message=_TRIPPED))
            self._start_program()

    def _recover(self, now: float, modes: Modes) -> None:
        assert self._recovery is not None
        result = self._recovery.step(
            now, modes.safety, modes.robot, program_running=self._control.running
        )
        if result is not None:
            self._recovery = None
            self._send(pack_text("recovered", ok=result.ok, message=result.message))

    def _send(self, message: bytes) -> None:
        # The parent reads all the time; if it does not, the newest state is not worth waiting for.
        with contextlib.suppress(BlockingIOError):
            self._channel.send(message, socket.MSG_DONTWAIT)

    def leave(self) -> None:
        """Bring the arm to rest, end the program and disconnect."""
        self._stop()
        self._control.leave()
        if self._receive is not None:
            self._receive.disconnect()


def _rate(version: str, wanted: float) -> float:
    """Hz of a controller's cycles, in which the limits count. Raises DeviceError where another rate
    than that, or 0, is wanted.
    """
    digits = "".join(c if c.isdigit() else " " for c in version).split()
    rate = 125.0 if digits and int(digits[0]) < 5 else 500.0
    if wanted not in (0.0, rate):
        raise DeviceError(
            f"the UR controller has {rate:g} cycles a second, not {wanted:g}: set the rate to 0"
            " (link.rate in wrist.yaml)"
        )
    return rate


def _end_with_parent(parent: int) -> None:
    """Let the kernel kill this process when its parent dies, however it dies (Linux)."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)
    if os.getppid() != parent:  # it died before we asked: its successor must have the arm alone
        os._exit(0)


def main() -> None:
    """Run one link from start to loss."""
    # The parent decides when to end: Ctrl-C in a terminal reaches this process too, and must not
    # cut the arm off in motion.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _end_with_parent(int(sys.argv[2]))
    channel = socket.socket(fileno=int(sys.argv[1]))
    # Checked by the parent; what checks it takes longer to import than everything else here.
    config = json.loads(sys.argv[3], object_hook=lambda found: SimpleNamespace(**found))
    worker = Worker(channel, cast("UrConfig", config), starts_program=sys.argv[4] == "1")
    gc.collect()
    gc.freeze()
    # From the start: the watchdog runs as soon as the program does.
    request_realtime()
    try:
        worker.connect()
        worker.run()
        worker.leave()
    except (DeviceError, RuntimeError, OSError) as error:
        with contextlib.suppress(OSError):
            channel.send(pack_text("lost", message=" ".join(str(error).split())))
    # The library's threads may wait for a dead controller: leave without joining them.
    os._exit(0)


if __name__ == "__main__":
    main()
