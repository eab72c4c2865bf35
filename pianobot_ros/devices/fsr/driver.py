"""Driver of the force sensor's microcontroller."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from pianobot_ros.devices.base import (
    CommandRejectedError,
    DeviceUnavailableError,
    Health,
    HealthLevel,
)
from pianobot_ros.devices.device_clock import DeviceClock
from pianobot_ros.devices.fsr.calibration import FsrCalibration
from pianobot_ros.devices.fsr.config import FsrConfig
from pianobot_ros.devices.serial_line import FSR_DEVICE, Line, SerialLink

__all__ = ["FsrDriver", "FsrReading"]

_TRAVEL = 0.1  # m that no key's front is away from its rest


@dataclass(slots=True)
class FsrReading:
    """One sample: ``time_ns`` host time of the measurement, ``own_ns`` its time by the board's own
    clock, ns since some moment (intervals only), ``sequence`` unwrapped, ``counts`` of
    the converter, ``force`` N, ``saturated``, and ``encoder`` counts or None where no encoder is
    fitted.
    """

    time_ns: int
    own_ns: int
    sequence: int
    counts: int
    force: float
    saturated: bool
    encoder: int | None


class FsrDriver:
    """Force of the fingertip on one key. Implements :class:`pianobot_ros.devices.base.Device`; a
    command is a rate in Hz.

    Args:
        config: the file ``fsr.yaml``.
        on_readings: called on the driver's thread with the samples of one read, oldest first.
        on_event: called with a level and one line of text when the link is lost or comes back,
            and when samples end or go on.
    """

    def __init__(
        self,
        config: FsrConfig,
        on_readings: Callable[[list[FsrReading]], None] = lambda readings: None,
        on_event: Callable[[HealthLevel, str], None] = lambda level, text: None,
    ) -> None:
        self.config = config
        self.calibration = FsrCalibration(
            config.calibration.counts, config.calibration.force, config.sensor.bits
        )
        self._on_readings = on_readings
        self._link = SerialLink(
            config.link, FSR_DEVICE, self._on_lines, on_connect=self._set_up, on_event=on_event
        )
        self._clock = DeviceClock(config.sensor.clock)
        self._rate = config.sensor.rate
        self._link.rhythm.period = 1.0 / self._rate
        self._latest: FsrReading | None = None
        self._sequence = 0
        travel = round(_TRAVEL * config.encoder.resolution)
        self._bounds = [(0, 2**32 - 1), (0, self.calibration.top), (-travel, travel)]
        self.saturated = 0
        self.implausible = 0
        self.refused = ""

    def connect(self) -> None:
        """Open the port, identify the device and start the stream. Raises
        DeviceUnavailableError.
        """
        self._link.connect()
        problem = self._mismatch()
        if problem:
            self._link.close()
            raise DeviceUnavailableError(problem)

    def _mismatch(self) -> str:
        """What the device says of itself and the configuration denies."""
        features = self._link.identity.features if self._link.identity else {}
        bits = features.get("bits", "")
        if bits and bits != str(self.config.sensor.bits):
            return (
                f"{self._link.path}: the converter has {bits} bits, fsr.yaml says"
                f" {self.config.sensor.bits}: correct 'bits'"
            )
        if self.config.encoder.fitted and features.get("encoder", "1") == "0":
            return (
                f"{self._link.path}: the device has no key encoder: set 'fitted: false' in fsr.yaml"
            )
        return ""

    def latest(self) -> FsrReading | None:
        """Newest sample, or None."""
        return self._latest

    def write(self, command: float) -> float:
        """Set the sample rate, Hz; returns it as clipped to 1 to 1000.

        Raises:
            CommandRejectedError: not a number.
            DeviceUnavailableError: the device is away; it gets the rate when it is back.
        """
        if math.isnan(command):
            raise CommandRejectedError("the sample rate is not a number")
        self._rate = float(min(max(command, 1.0), 1000.0))
        self._link.rhythm.period = 1.0 / self._rate
        if not self._link.send("R", round(self._rate)):
            raise DeviceUnavailableError("the FSR reader is away; it gets the rate when it is back")
        return self._rate

    def health(self) -> Health:
        """Link and sensor."""
        health = self._link.health()
        latest = self._latest
        values = {
            **health.values,
            "rate_hz": self._rate,
            "force_n": latest.force if latest else float("nan"),
            "saturated": self.saturated,
            "implausible": self.implausible,
            "clock": self._clock.mode,
        }
        level, message = health.level, health.message
        if level is HealthLevel.OK and self.refused:
            level, message = HealthLevel.WARN, f"the device refused a command: {self.refused}"
        return Health(level, message, health.age_s, values)

    def close(self) -> None:
        """Stop the stream and release the port. May be called twice."""
        if self._link.connected:
            self._link.send("R", 0)
        self._link.close()

    # Thread of the link.

    def _set_up(self) -> None:
        self._clock.reset()
        self._link.send("R", round(self._rate))

    def _on_lines(self, lines: list[Line], time_ns: int) -> bool:
        readings, latency = [], round(1e9 * self.config.sensor.latency)
        table, top = self.calibration.force, self.calibration.top
        for line in lines:
            if line.kind == "F":
                try:
                    micros, counts, *rest = line.integers(*self._bounds[: max(len(line.fields), 2)])
                except ValueError:
                    self.implausible += 1
                    continue
                encoder = rest[0] if rest else None
                self._sequence += (line.sequence - self._sequence) % 65536
                saturated = counts >= top
                self.saturated += saturated
                stamp = self._clock.host_ns(micros, time_ns) - latency
                own, force = self._clock.own_ns, table(counts)
                readings.append(
                    FsrReading(stamp, own, self._sequence, counts, force, saturated, encoder)
                )
            elif line.kind == "E":
                self.refused = line.fields[-1] if line.fields else "no reason given"
            elif line.kind == "A":
                self.refused = ""
        if readings:
            self._latest = readings[-1]
            self._on_readings(readings)
        return bool(readings)
