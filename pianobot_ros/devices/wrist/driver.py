"""The driver of the arm, as the node sees it: a small object that never blocks on the link."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable

import numpy as np

from pianobot_ros.cell.host.marks import Mark
from pianobot_ros.cell.host.wall_clock import AHEAD, WallClock
from pianobot_ros.devices.base import (
    CommandRejectedError,
    DeviceUnavailableError,
    Health,
    HealthLevel,
)
from pianobot_ros.devices.wrist.config import UrConfig
from pianobot_ros.devices.wrist.frames import MountFrames
from pianobot_ros.devices.wrist.limits.limiter import SetpointLimiter
from pianobot_ros.devices.wrist.messages import HALT, RECOVER, RawReading, Setpoint
from pianobot_ros.devices.wrist.worker_supervisor import WorkerSupervisor
from pianobot_ros.devices.wrist.wrist_reading import SafetyState, WristReading, WristSetpoint

__all__ = ["UrDriver"]

_RECOVER_LIMIT = 45.0


class UrDriver:
    """A UR arm that carries the hand; a Device of ``WristSetpoint`` and ``WristReading``.

    Args:
        config: from ``wrist.yaml``.
        on_reading: called with every package of the controller, on the driver's own thread.
        on_event: called with (severity, text) when the link is lost or comes back, on the driver's
            own thread.
        stopped: that :meth:`stop` was called, and no recovery succeeded since.
        ended: that the controller's program was ended while this driver looked.
    """

    def __init__(
        self,
        config: UrConfig,
        on_reading: Callable[[WristReading], None] = lambda reading: None,
        on_event: Callable[[HealthLevel, str], None] = lambda level, text: None,
        *,
        stopped: Mark | None = None,
        ended: Mark | None = None,
    ) -> None:
        self.config = config
        self._frames = MountFrames(config.mount)
        self._on_reading = on_reading
        ended = Mark() if ended is None else ended
        self._supervisor = WorkerSupervisor(config, self._take_reading, on_event, ended)
        self._limiter: SetpointLimiter | None = None
        self._latest: WristReading | None = None
        self._lock = threading.Lock()
        self._sequence = 0
        self._last_due = -math.inf
        self._stopped = Mark() if stopped is None else stopped
        self._stops = 0
        self._clock = WallClock()
        self._latencies: deque[float] = deque(maxlen=2000)
        self.counts = {"written": 0, "clamped": 0, "rejected": 0, "implausible": 0}
        self.last_clamp = ""

    # Device protocol.

    def connect(self) -> None:
        """Start the driver's process and wait for the first state.

        Raises:
            DeviceUnavailableError: no controller there, or it does not answer. The message says
                which and what to do.
        """
        self._supervisor.start()
        try:
            self._supervisor.wait_ready()
        except DeviceUnavailableError:
            self.close()
            raise

    def latest(self) -> WristReading | None:
        """Newest state, or None before the first."""
        return self._latest

    def write(self, command: WristSetpoint) -> WristSetpoint:
        """Send a setpoint and return what was really sent after clamping.

        One that is stamped ahead of the present time is given to the arm at that time, in step with
        the controller's cycles; the arm is stopped when the last one's time has passed and no other
        came.

        Raises:
            CommandRejectedError: not finite, outside the workspace, or the arm is stopped.
            DeviceUnavailableError: no link.
        """
        with self._lock:
            try:
                return self._write(command)
            except CommandRejectedError:
                self.counts["rejected"] += 1
                raise

    def health(self) -> Health:
        """State of link and arm."""
        reading = self._latest
        age = math.inf if reading is None else time.monotonic() - reading.monotonic
        level, message = self._judge(reading, age)
        values: dict[str, float | int | str] = {
            **self.counts,
            "restarts": self._supervisor.restarts,
            "rate_hz": self._supervisor.rate,
            "controller": self._supervisor.version,
        }
        if reading is not None:
            values |= {
                "safety": reading.safety.name,
                "robot_mode": reading.robot_mode,
                "program_running": str(reading.program_running),
                "speed_scaling": reading.speed_scaling,
                "controller_time_s": reading.controller_time,
            }
        if latencies := sorted(self._latencies):
            values["latency_p50_ms"] = 1e3 * latencies[len(latencies) // 2]
            values["latency_p99_ms"] = 1e3 * latencies[int(0.99 * (len(latencies) - 1))]
        return Health(level, message, age, values)

    def close(self) -> None:
        """Bring the arm to rest and end the driver's process. May be called twice."""
        self._supervisor.stop()

    # More than the protocol.

    def stop(self) -> None:
        """Stop the arm at once and refuse setpoints until :meth:`recover`."""
        with self._lock:  # no setpoint that is being written may come after it
            self._stopped.set()
            self._stops += 1
        self.rest()

    def rest(self) -> None:
        """Stop the arm now; the next setpoint moves it again."""
        with self._lock:
            self._last_due = -math.inf
            self._supervisor.send(HALT)

    def recover(self, done: Callable[[bool, str], None]) -> None:
        """Unlock a protective stop, power up after a released emergency stop, restart the program.

        Returns at once; ``done`` is called once with success and one line, on the driver's own
        thread. A stop meanwhile outlasts it.
        """
        stops = self._stops

        def finish(ok: bool, message: str) -> None:
            with self._lock:
                if ok and self._stops != stops:
                    ok = False
                    message = "the arm was stopped on request meanwhile: call recover again"
                self._stopped.set(bool(self._stopped) and not ok)
            done(ok, message)

        if not self._supervisor.request(RECOVER, finish, _RECOVER_LIMIT):
            done(False, self._supervisor.problem or "no link to the UR controller")

    @property
    def process_id(self) -> int | None:
        """Of the process that holds the client library; None while there is none."""
        return self._supervisor.pid

    def latencies(self) -> list[float]:
        """Time from write to the state in which the controller echoes the setpoint, s, for recent
        setpoints.
        """
        return list(self._latencies)

    def _write(self, command: WristSetpoint) -> WristSetpoint:
        reading = self._latest
        now = time.monotonic()
        if not self._supervisor.ready or reading is None:
            raise DeviceUnavailableError(
                self._supervisor.problem or "no link to the UR controller yet"
            )
        if refusal := self._refusal(reading):
            raise CommandRejectedError(refusal)
        limiter = self._limiter
        if limiter is None:
            limiter = SetpointLimiter(
                self.config.limits, self.config.workspace, 1.0 / self._supervisor.rate
            )
            self._limiter = limiter
        if now - self._last_due > self.config.limits.stale:
            limiter.restart(np.array(reading.position), np.array(reading.rotation), now)
        limited = limiter.limit(command, now)
        due = self._clock.monotonic(round(1e9 * command.stamp))
        due = due if now < due <= now + AHEAD else now
        self._last_due = due
        self._sequence += 1
        passed = limited.setpoint
        pose = self._frames.tool(passed.position.tolist(), passed.rotation.tolist())
        if not self._supervisor.send(Setpoint(self._sequence, now, due, pose).pack()):
            raise DeviceUnavailableError(
                self._supervisor.problem or "the driver's process does not take setpoints"
            )
        self.counts["written"] += 1
        self.counts["clamped"] += bool(limited.clamped)
        self.last_clamp = limited.clamped
        return passed

    def _refusal(self, reading: WristReading) -> str:
        """Why the arm would not obey now; empty if it would."""
        if not reading.safety.can_move:
            return f"the arm is in {reading.safety.name}: clear its cause, then call recover"
        if not reading.program_running:
            return "the controller's program does not run: call recover to start it"
        return (
            "the arm was stopped on request: call recover to move it again" if self._stopped else ""
        )

    def _take_reading(self, raw: RawReading) -> None:
        if not raw.plausible:
            self.counts["implausible"] += 1
            return
        reading = self._frames.reading(raw)
        if not math.isnan(raw.latency):
            self._latencies.append(raw.latency)
        self._latest = reading
        self._on_reading(reading)

    def _judge(self, reading: WristReading | None, age: float) -> tuple[HealthLevel, str]:
        if not self._supervisor.ready:
            return HealthLevel.ERROR, self._supervisor.problem or "connecting"
        if reading is None or age > self.config.link.state_timeout:
            return HealthLevel.STALE, f"no state from the controller for {age:.2f} s"
        if refusal := self._refusal(reading):
            return HealthLevel.WARN if self._stopped else HealthLevel.ERROR, refusal
        if reading.safety is SafetyState.REDUCED or reading.speed_scaling < 0.999:
            return HealthLevel.WARN, f"slowed down to {100 * reading.speed_scaling:.0f} %"
        return HealthLevel.OK, "streaming" if reading.servoing else "ready"
