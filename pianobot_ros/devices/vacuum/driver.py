"""Driver of the vacuum regulator."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from pianobot_ros.devices.attended import Attended
from pianobot_ros.devices.base import (
    CommandRejectedError,
    DeviceUnavailableError,
    Health,
    HealthLevel,
)
from pianobot_ros.devices.device_clock import DeviceClock
from pianobot_ros.devices.serial_line import REGULATOR_DEVICE, Line, SerialLink
from pianobot_ros.devices.vacuum.config import RegulatorConfig

__all__ = ["RegulatorDriver", "VacuumReading", "VacuumSetpoint"]

_CHANNELS = 3
_REPORT = [  # what the fields of a report may be: us, setpoints and measured pressures in Pa
    (0, 2**32 - 1),
    *[(-101_325, 0)] * _CHANNELS,
    *[(-110_000, 50_000)] * _CHANNELS,  # a sensor has an offset
]
_FOLLOW_TIME = 0.3  # s that a setpoint may take to show in the reports


@dataclass(frozen=True)
class VacuumSetpoint:
    """Wanted gauge pressure of each channel, Pa, 0 (no vacuum) to -100000."""

    pressure: tuple[float, float, float]


@dataclass(frozen=True)
class VacuumReading:
    """One report: ``time_ns`` host time of the measurement (intervals are the device's own),
    ``sequence`` unwrapped, ``setpoint`` as the device understood it and ``measured``, Pa gauge by
    channel.
    """

    time_ns: int
    sequence: int
    setpoint: tuple[float, float, float]
    measured: tuple[float, float, float]


class RegulatorDriver:
    """Vacuum of three fingers. Implements :class:`pianobot_ros.devices.base.Device`.

    Setpoints are sent by a thread of the driver's own, which repeats the last one; so ``write``
    never waits for the port, a lost line does no harm, and a device that was unplugged gets its
    setpoint again when it is back.

    Args:
        config: the file ``vacuum.yaml``.
        on_reading: called on the driver's thread with each report.
        on_event: called with a level and one line of text when the link is lost or comes back,
            and when reports end or go on.
    """

    def __init__(
        self,
        config: RegulatorConfig,
        on_reading: Callable[[VacuumReading], None] = lambda reading: None,
        on_event: Callable[[HealthLevel, str], None] = lambda level, text: None,
    ) -> None:
        self.config = config
        self._on_reading, self._on_event = on_reading, on_event
        self._clock = DeviceClock("fixed")
        self._link = SerialLink(
            config.link,
            REGULATOR_DEVICE,
            self._on_lines,
            on_connect=self._set_up,
            on_event=on_event,
        )
        self._latest: VacuumReading | None = None
        self._target: tuple[int, int, int] | None = None
        self._target_at = 0.0
        self._wake = threading.Condition()
        self._pending = False
        self._closing = False
        self._sender: Attended | None = None
        self._sequence = 0
        self.implausible = 0
        self.clipped = 0
        self.rejected = 0
        self.refused = ""

    def connect(self) -> None:
        """Open the port and identify the device. Raises DeviceUnavailableError."""
        self._closing = False
        self._link.connect()
        if self._sender is None:
            self._sender = Attended(
                self._send,
                "vacuum setpoints",
                lambda text: self._on_event(HealthLevel.ERROR, f"internal error: {text}"),
            )
            self._sender.start()

    def latest(self) -> VacuumReading | None:
        """Newest report, or None."""
        return self._latest

    def write(self, command: VacuumSetpoint) -> VacuumSetpoint:
        """Set the pressures; returns them as clipped to the limits and rounded to whole Pa.

        Raises:
            CommandRejectedError: not three finite numbers; nothing changes.
            DeviceUnavailableError: the device is away; the setpoint is kept and sent when it is
                back.
        """
        pressure = command.pressure
        if len(pressure) != _CHANNELS or not all(math.isfinite(p) for p in pressure):
            self.rejected += 1
            raise CommandRejectedError(
                f"vacuum setpoint {tuple(pressure)} must be {_CHANNELS} finite pressures in Pa"
            )
        limits = self.config.limits
        a, b, c = (round(min(max(p, limits.lowest), limits.highest)) for p in pressure)
        self.clipped += any(abs(x - p) > 0.5 for x, p in zip((a, b, c), pressure, strict=True))
        with self._wake:
            if (a, b, c) != self._target:
                self._target_at = time.monotonic()
            self._target = (a, b, c)
            self._pending = True
            self._wake.notify()
        if not self._link.connected:
            raise DeviceUnavailableError(
                "the vacuum regulator is away; it gets the setpoint when it is back"
            )
        return VacuumSetpoint((float(a), float(b), float(c)))

    @property
    def target(self) -> VacuumSetpoint:
        """The setpoint in force; no vacuum before the first."""
        a, b, c = self._target or (0, 0, 0)
        return VacuumSetpoint((float(a), float(b), float(c)))

    def vent(self) -> None:
        """Ask for no vacuum in any finger."""
        self.write(VacuumSetpoint((0.0, 0.0, 0.0)))

    def health(self) -> Health:
        """Link and regulation."""
        health = self._link.health()
        values = {
            **health.values,
            "clipped": self.clipped,
            "rejected": self.rejected,
            "implausible": self.implausible,
        }
        level, message = health.level, health.message
        latest, target = self._latest, self._target
        if level is HealthLevel.OK and latest is not None and target is not None:
            off = max(abs(s - t) for s, t in zip(latest.setpoint, target, strict=True))
            if (
                off > self.config.behaviour.follow_tolerance
                and time.monotonic() - self._target_at > _FOLLOW_TIME
            ):
                level, message = (
                    HealthLevel.WARN,
                    f"the device's setpoint is {off:.0f} Pa off the one that was sent",
                )
        if level is HealthLevel.OK and self.refused:
            level, message = HealthLevel.WARN, f"the device refused a command: {self.refused}"
        return Health(level, message, health.age_s, values)

    def close(self, vent: bool = True) -> None:
        """Vent (unless told otherwise) and release the port. May be called twice."""
        with self._wake:
            self._closing = True
            self._wake.notify()
        sender, self._sender = self._sender, None
        if sender is not None:
            sender.join(1.0)
            if vent:
                self._link.send("S", *[0] * _CHANNELS)
            elif self.config.behaviour.vent_after > 0.0:
                self._link.send("W", 0)  # hold the pressure, although the host falls silent
        self._link.close()

    # Threads.

    def _set_up(self) -> None:
        self._clock.reset()
        self._link.send("W", round(1e3 * self.config.behaviour.vent_after))
        with self._wake:
            self._pending = self._target is not None
            self._wake.notify()

    def _send(self) -> None:
        while True:
            with self._wake:
                if not self._pending and not self._closing:
                    self._wake.wait(self.config.behaviour.refresh)
                if self._closing:
                    return
                self._pending = False
                target = self._target
            if target is not None:
                self._link.send("S", *target)
            else:
                self._link.send("N")  # a sign of life only

    def _on_lines(self, lines: list[Line], time_ns: int) -> bool:
        measured = False
        for line in lines:
            if line.kind == "E":
                self.refused = line.fields[-1] if line.fields else "no reason given"
            elif line.kind == "A":
                self.refused = ""
            elif line.kind == "P" and (reading := self._reading(line, time_ns)) is not None:
                self._latest, measured = reading, True
                self._on_reading(reading)
        return measured

    def _reading(self, line: Line, time_ns: int) -> VacuumReading | None:
        try:
            micros, *pressures = line.integers(*_REPORT)
        except ValueError:
            self.implausible += 1
            return None
        self._sequence += (line.sequence - self._sequence) % 65536
        s0, s1, s2, m0, m1, m2 = map(float, pressures)
        return VacuumReading(
            self._clock.host_ns(micros, time_ns), self._sequence, (s0, s1, s2), (m0, m1, m2)
        )
