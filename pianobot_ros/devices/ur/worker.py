"""The process that holds the client library ``ur_rtde``.

It lives apart from the node because the library's constructor can wait for ever with the interpreter locked, because
calls hang when the controller is gone, and because its own reconnection can crash. Its parent watches it and kills it.

Started as ``python -m pianobot_ros.devices.ur.worker FD CONFIG`` with one end of a socket pair and the configuration as
JSON. When the link is lost it says so and exits; the parent starts another.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import math
import os
import select
import signal
import socket
import sys
import threading
import time
from collections import deque
from pathlib import Path

import dashboard_client
import rtde_control
import rtde_receive

from pianobot_ros.cell.clocks import WallClock
from pianobot_ros.cell.errors import DeviceError
from pianobot_ros.cell.priority import keep_pace, start_up
from pianobot_ros.devices.ur.config import UrConfig
from pianobot_ros.devices.ur.messages import HALT, QUIT, RECOVER, SETPOINT, RawReading, Setpoint, pack_text
from pianobot_ros.devices.ur.probe import probe
from pianobot_ros.devices.ur.recovery import Recovery
from pianobot_ros.devices.ur.stream import CycleClock, SetpointStream

__all__ = ["main"]

_VARIABLES = [
    "timestamp",
    "actual_q",
    "actual_qd",
    "actual_current",
    "actual_TCP_pose",
    "actual_TCP_speed",
    "target_TCP_pose",
    "robot_mode",
    "safety_mode",
    "runtime_state",
    "robot_status_bits",
    "safety_status_bits",
    "speed_scaling",
    "target_speed_fraction",
]
_STOPPED, _PLAYING = 1, 2
_RUNNING = 7
_CAN_MOVE = (1, 2)  # safety modes normal and reduced
_KICK_PERIOD = 0.04  # s; the watchdog trips after 1 / watchdog_rate
_BLAME_TIME = 0.5  # s after a late kick within which a stopped program counts as stopped by the watchdog
_STOP_LIMIT = 1.0  # s that a stop may take before the link counts as dead
_PR_SET_TIMERSLACK = 29
_LOOSE = 0.002  # s by which the control interface may see the controller's answers late
_SET_UP_TIME = 8.0  # s that building the control interface may take, its own limit for starting the script included


def _threads() -> set[int]:
    """Ids of this process's threads; none where the system does not tell."""
    with contextlib.suppress(OSError):
        return {int(entry.name) for entry in Path("/proc/self/task").iterdir()}
    return set()


def _timer_slack(seconds: float) -> None:
    """How much later than asked the sleeps of threads may end that this thread starts from here on; 0: the usual 50 us."""
    with contextlib.suppress(OSError, AttributeError):  # Linux
        ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, round(1e9 * seconds), 0, 0, 0)


def send_at_once(port: int) -> int:
    """Switch Nagle's algorithm off on this process's connections to ``port``; returns on how many it was on.

    The library leaves it on. A setpoint then waits until the controller's next package acknowledges the one before: a
    whole cycle more, in some phases of the stream, for as long as the stream lasts.
    """
    changed = 0
    for entry in Path("/proc/self/fd").iterdir():
        try:
            connection = socket.socket(fileno=os.dup(int(entry.name)))
        except OSError:  # no socket, or closed meanwhile
            continue
        with connection, contextlib.suppress(OSError):
            if connection.family == socket.AF_INET and connection.getpeername()[1] == port:
                changed += not connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return changed


class Worker:
    """The link to one controller."""

    def __init__(self, channel: socket.socket, config: UrConfig) -> None:
        self._channel, self._config = channel, config
        self._receive: rtde_receive.RTDEReceiveInterface | None = None
        self._control: rtde_control.RTDEControlInterface | None = None
        self._sequence = 0
        self._applied = 0
        self._servoing = False
        self._last_setpoint = 0.0
        self._last_sent = 0.0
        self._own_silence = -math.inf  # when this process last starved the controller's watchdog
        self._package_time = 0.0
        self._stream, self._clock, self._wall = SetpointStream(), CycleClock(), WallClock()
        self._echo: deque[Setpoint] = deque(maxlen=8)
        self._recovery: Recovery | None = None
        self._greeting = b""
        self._stopping: threading.Thread | None = None
        self._stop_begun = 0.0
        self._unhurried: set[int] = set()
        self._safety_mode = self._robot_mode = self._runtime_state = 0
        self.period = 0.008

    # Link.

    def connect(self) -> None:
        """Find the controller, receive its state, and start the control program if the arm can move."""
        link = self._config.link
        probe(link.host)
        dashboard = self._dashboard()
        version = dashboard.polyscopeVersion()
        dashboard.disconnect()
        digits = "".join(c if c.isdigit() else " " for c in version).split()
        rate = link.rate or (125.0 if digits and int(digits[0]) < 5 else 500.0)
        self.period = 1.0 / rate
        self._receive = rtde_receive.RTDEReceiveInterface(link.host, rate, _VARIABLES)
        self._wait_for_package()
        if self._can_move():
            self.start_control()
        self._greeting = pack_text("ready", rate=rate, version=version)

    def start_control(self) -> None:
        """Upload the control program and tell it about hand and watchdog. Raises RuntimeError if it does not start."""
        self._send(pack_text("busy", seconds=_SET_UP_TIME))
        if self._control is not None:
            self._control.disconnect()
            self._control = None
        before = _threads()
        _timer_slack(_LOOSE)
        control = rtde_control.RTDEControlInterface(self._config.link.host, 1.0 / self.period)
        _timer_slack(0.0)
        self._unhurried = _threads() - before
        self.unhurry()
        mount = self._config.mount
        send_at_once(30004)
        control.setTcp([*mount.tcp_offset, 0.0, 0.0, 0.0])
        control.setPayload(mount.payload, list(mount.payload_centre))
        control.setWatchdog(self._config.link.watchdog_rate)
        control.kickWatchdog()
        self._control, self._servoing = control, False
        self._last_sent = time.monotonic()

    def unhurry(self) -> None:
        """The control interface reads the controller's state on a thread of its own, which looks for it nearly three thousand
        times a second. Nothing in it is urgent: the state that counts comes through the receive interface."""
        for thread in self._unhurried:
            with contextlib.suppress(OSError, AttributeError):
                os.sched_setscheduler(thread, os.SCHED_OTHER, os.sched_param(0))

    def _dashboard(self) -> dashboard_client.DashboardClient:
        dashboard = dashboard_client.DashboardClient(self._config.link.host)
        dashboard.connect()
        return dashboard

    def _wait_for_package(self) -> None:
        assert self._receive is not None
        deadline = time.monotonic() + 2.0
        while self._receive.getTimestamp() <= 0.0:
            if time.monotonic() > deadline:
                raise DeviceError("the UR controller accepted the connection but sends no state")
            time.sleep(self.period)
        self._read_modes()

    def _read_modes(self) -> None:
        assert self._receive is not None
        self._safety_mode = self._receive.getSafetyMode()
        self._robot_mode = self._receive.getRobotMode()
        self._runtime_state = self._receive.getRuntimeState()

    def _can_move(self) -> bool:
        return self._safety_mode in _CAN_MOVE and self._robot_mode == _RUNNING

    def _obeys(self) -> bool:
        """Whether a command would be executed now; otherwise the library may wait for minutes."""
        return (
            self._control is not None
            and self._stopping is None
            and self._can_move()
            and self._runtime_state == _PLAYING
            and self._control.isConnected()
        )

    # Loop.

    def run(self) -> None:
        """Serve until told to quit. Raises DeviceError when the link is lost."""
        assert self._receive is not None
        early = min(0.0006, 0.3 * self.period)  # look for the next package a little before it is due
        poll = min(0.00025, 0.125 * self.period)
        self._package_time = time.monotonic()
        stamp = -1.0
        due = self._package_time
        while True:
            wake = min(due, self._last_setpoint + self._config.limits.stale) if self._servoing else due
            readable, _, _ = select.select([self._channel], [], [], max(0.0, wake - time.monotonic()))
            if readable and not self._take_orders():
                return
            now = time.monotonic()
            if now >= due:
                newest = self._receive.getTimestamp()
                if newest != stamp:
                    stamp, now = newest, time.monotonic()  # anew: noticed never before it came
                    cycle = self._clock.read(now, stamp)
                    self._follow(cycle)
                    self._package(now, cycle)
                    due = now + self.period - early
                else:
                    self._check_link(now)
                    due = now + poll
            self._watch_stop(now)
            self._watch_stream(now)

    def _take_orders(self) -> bool:
        """Read everything that waits; of several setpoints that are due only the newest counts. False to quit."""
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
                newest = Setpoint.unpack(message)
                if self._stream or newest.due > soon:
                    self._stream.add(newest)  # sent in the controller's cycles from here on, see _follow
                else:
                    setpoint = newest
            elif kind == HALT:
                setpoint = None
                self._stop()
            elif kind == RECOVER:
                self._recovery = Recovery(self._dashboard, self.start_control, time.monotonic())
        if setpoint is not None:
            self._servo(setpoint)
        return True

    def _follow(self, cycle: float) -> None:
        """Send what of the stream is for the controller's next cycle; ``cycle`` is the monotonic time of the present one."""
        if not self._stream:
            return
        ahead = cycle + self._config.servo.ahead * self.period
        setpoint = self._stream.at(ahead)
        if setpoint is not None:
            self._servo(setpoint)
        if ahead > self._stream.end + self._config.limits.stale:
            self._stream.clear()
            self._stop()

    def _servo(self, setpoint: Setpoint) -> None:
        if not self._obeys() or not all(map(math.isfinite, setpoint.pose)):
            return
        assert self._control is not None
        servo = self._config.servo
        # Its return value says nothing: it is True on a dead link too. The echo in the state is what counts.
        self._control.servoL(list(setpoint.pose), 0.5, 0.5, self.period, servo.lookahead, servo.gain)
        now = time.monotonic()
        self._applied, self._servoing = setpoint.sequence, True
        self._last_setpoint = now
        self._sent(now)
        self._echo.append(setpoint)

    def _stop(self) -> None:
        self._stream.clear()
        if self._servoing and self._obeys():
            assert self._control is not None
            # The call returns when the arm is at rest, or never on a dead link. The state has to flow meanwhile.
            self._stopping = threading.Thread(
                target=self._control.servoStop, args=(self._config.servo.stop_deceleration,), daemon=True
            )
            self._stop_begun = time.monotonic()
            self._stopping.start()
        self._servoing = False
        self._echo.clear()

    def _watch_stop(self, now: float) -> None:
        if self._stopping is None:
            return
        if not self._stopping.is_alive():
            self._stopping = None
            self._sent(now)
        elif now - self._stop_begun > _STOP_LIMIT:
            raise DeviceError(f"the UR controller did not confirm a stop within {_STOP_LIMIT:g} s")

    def _watch_stream(self, now: float) -> None:
        """Stop on a stale stream; keep the controller's watchdog quiet while there is no stream."""
        if self._servoing and now - self._last_setpoint >= self._config.limits.stale:
            self._stop()
        elif not self._servoing and now - self._last_sent > _KICK_PERIOD and self._obeys():
            assert self._control is not None
            self._control.kickWatchdog()
            self._sent(time.monotonic())

    def _sent(self, now: float) -> None:
        """Note that the controller's watchdog was fed, and whether late."""
        if now - self._last_sent > 0.8 / self._config.link.watchdog_rate:
            self._own_silence = now
        self._last_sent = now

    def _revive(self, now: float) -> None:
        """Start the program again if it was our own delay, on a busy machine, that let the watchdog stop it.

        The arm is at rest then, and only fresh setpoints move it. A program that ended for any other reason stays down
        until somebody asks for recovery.
        """
        stopped = self._control is not None and self._can_move() and self._runtime_state == _STOPPED
        if stopped and now - self._own_silence < _BLAME_TIME:
            self._own_silence = -math.inf
            self._send(
                pack_text("note", message="the watchdog tripped because this machine was busy; program restarted")
            )
            self.start_control()

    def _check_link(self, now: float) -> None:
        assert self._receive is not None
        if not self._receive.isConnected():
            raise DeviceError("the UR controller closed the connection")
        if now - self._package_time > self._config.link.state_timeout:
            raise DeviceError(f"the UR controller has been silent for {now - self._package_time:.2f} s")
        if self._control is not None and not self._control.isConnected():
            raise DeviceError("the UR controller closed the control connection")

    def _package(self, now: float, cycle: float) -> None:
        """Hand a package on that was noticed at ``now``; its ``cycle`` began before. Both monotonic, s."""
        receive = self._receive
        assert receive is not None
        self._package_time = now
        self._sequence += 1
        self._read_modes()
        if not self._can_move():
            self._servoing = False
        target = receive.getTargetTCPPose()
        reading = RawReading(
            sequence=self._sequence,
            time_ns=self._wall.wall_ns(cycle),
            monotonic=now,
            controller_time=receive.getTimestamp(),
            applied=self._applied,
            latency=self._echo_latency(target, now),
            servoing=self._servoing,
            safety_mode=self._safety_mode,
            robot_mode=self._robot_mode,
            runtime_state=self._runtime_state,
            speed_scaling=receive.getSpeedScaling() * receive.getTargetSpeedFraction(),
            pose=receive.getActualTCPPose(),
            speed=receive.getActualTCPSpeed(),
            target=target,
            q=receive.getActualQ(),
            qd=receive.getActualQd(),
            current=receive.getActualCurrent(),
        )
        if reading.finite:
            self._send(reading.pack())
            if self._greeting:  # the parent learns that the link is up when it has a state
                self._send(self._greeting)
                self._greeting = b""
        if self._recovery is not None:
            self._recover(now)
        else:
            self._revive(now)

    def _recover(self, now: float) -> None:
        assert self._recovery is not None
        obeys = self._control is not None and self._runtime_state == _PLAYING and self._control.isConnected()
        result = self._recovery.step(now, self._safety_mode, self._robot_mode, program_running=obeys)
        if result is not None:
            self._recovery = None
            self._send(pack_text("recovered", ok=result.ok, message=result.message))

    def _echo_latency(self, target: list[float], now: float) -> float:
        """Age of the setpoint that the controller says it is following; NaN if it is none of the recent ones."""
        for index in range(len(self._echo) - 1, -1, -1):
            if all(abs(a - b) < 1e-7 for a, b in zip(self._echo[index].pose[:3], target[:3], strict=True)):
                latency = now - self._echo[index].written
                for _ in range(index + 1):
                    self._echo.popleft()
                return latency
        return math.nan

    def _send(self, message: bytes) -> None:
        # The parent reads all the time; if it does not, the newest state is not worth waiting for.
        with contextlib.suppress(BlockingIOError):
            self._channel.send(message, socket.MSG_DONTWAIT)

    def leave(self) -> None:
        """Bring the arm to rest, end the program and disconnect."""
        self._stop()
        if self._stopping is not None:
            self._stopping.join(_STOP_LIMIT)
        if self._control is not None and self._control.isConnected():
            if self._runtime_state == _PLAYING:
                self._control.stopScript()
            self._control.disconnect()
        if self._receive is not None:
            self._receive.disconnect()


def main() -> None:
    """Run one link from start to loss."""
    # The parent decides when to end: Ctrl-C in a terminal reaches this process too, and must not cut the arm off in motion.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(OSError, AttributeError):  # Linux: die with the parent, however it dies
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)
    start_up()
    channel = socket.socket(fileno=int(sys.argv[1]))
    worker = Worker(channel, UrConfig.model_validate_json(sys.argv[2]))
    try:
        worker.connect()
        gc.collect()
        gc.freeze()
        keep_pace()
        worker.unhurry()
        worker.run()
        worker.leave()
    except (DeviceError, RuntimeError, OSError) as error:
        with contextlib.suppress(OSError):
            channel.send(pack_text("lost", message=" ".join(str(error).split())))
    # The library's threads may wait for a dead controller: leave without joining them.
    os._exit(0)


if __name__ == "__main__":
    main()
