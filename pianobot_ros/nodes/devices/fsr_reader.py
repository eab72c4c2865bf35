"""``fsr_reader``: the force sensor on one key and, where the rig is fitted, the key encoder; real
or emulated.

Publishes ``/real/fsr`` with every sample, and ``/real/key_angle`` at ``angle_rate``. While a press
lasts, ``/real/fsr/peak``
carries its largest force so far, a few messages for each press: enough for who only wants the peak.
"""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

from pianobot_msgs.msg import KeyAngle, KeyForce

from pianobot_ros.cell.motion.geometry import keyboard
from pianobot_ros.devices.fsr import FsrConfig, FsrDriver, FsrReading
from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.base.common import Health
from pianobot_ros.nodes.topics.template import Template

__all__ = ["FsrReader", "PeakFollower", "main"]

_FALLEN = 0.9  # a force below this share of the peak says that the peak is past


class PeakFollower:
    """Running peak of a press: says which samples are worth a message.

    ``threshold`` N begins and ends a press; a rising peak is reported at most every ``period`` s,
    and once when it is past.
    """

    def __init__(self, threshold: float, period: float) -> None:
        self._threshold = threshold
        self._period_ns = round(period * 1e9)
        self._peak: FsrReading | None = None
        self._reported = True
        self._last_ns = 0

    def feed(self, reading: FsrReading) -> FsrReading | None:
        """The peak to report now, or None."""
        if reading.force < self._threshold:
            if self._peak is None:
                return None
            done, self._peak = self._peak, None
            return None if self._reported else done
        peak = self._peak
        if peak is None or reading.force > peak.force:
            peak = self._peak = reading
            self._reported = False
        fallen = reading.force < _FALLEN * peak.force
        if self._reported or not (fallen or reading.time_ns - self._last_ns >= self._period_ns):
            return None
        self._reported = True
        self._last_ns = reading.time_ns
        return peak


class FsrReader(common.DeviceNode):
    """The lifecycle node; a thin shell around :class:`FsrDriver`."""

    def __init__(self, **options: Any) -> None:
        super().__init__("fsr_reader", **options)
        self._file_config = config = self.load_config(
            FsrConfig, "port, calibration and encoder of the force sensor"
        )
        self.declare_port(config.link, "microcontroller")
        self.declare("rate", config.sensor.rate, "Hz, samples a second", 1.0, 1000.0)
        self.declare(
            "note", config.sensor.note, "MIDI note of the key that carries the sensor", 0, 127
        )
        self.declare(
            "angle_rate", 500.0, "Hz of key_angle, at most that of the sensor", 1.0, 1000.0
        )
        self.declare(
            "encoder", config.encoder.fitted, "the key encoder is fitted: publish its angle"
        )
        self.declare(
            "clock",
            config.sensor.clock,
            "stamps: fixed (device clock), tracked (without its drift) or arrival (host)",
            choices=["fixed", "tracked", "arrival"],
        )
        self._driver: FsrDriver | None = None

    def _config(self) -> FsrConfig:
        def value(name: str) -> Any:
            return self.get_parameter(name).value

        config = self._file_config
        return config.model_copy(
            update={
                "link": config.link.model_copy(
                    update={"port": value("port"), "baud": value("baud")}
                ),
                "sensor": config.sensor.model_copy(
                    update={"rate": value("rate"), "note": value("note"), "clock": value("clock")}
                ),
                "encoder": config.encoder.model_copy(update={"fitted": value("encoder")}),
            }
        )

    # Lifecycle.

    def setup(self) -> None:
        """Open the port, identify the device and start its stream."""
        config = self._config()
        self.diagnostics.hardware_id = config.link.port
        self._forces = self.add_publisher(KeyForce, "/real/fsr", common.SENSOR_QOS)
        self._peaks = self.add_publisher(KeyForce, "/real/fsr/peak", common.EVENT_QOS)
        self._angles: Any = (
            self.add_publisher(KeyAngle, "/real/key_angle", common.SENSOR_QOS)
            if config.encoder.fitted
            else None
        )
        self._follower = PeakFollower(config.press.threshold, config.press.period)
        self._angle_every = max(
            1, round(config.sensor.rate / float(self.get_parameter("angle_rate").value))
        )
        self._rad = 1.0 / (config.encoder.resolution * keyboard().white.pivot)  # per count
        span = max(1, round(config.encoder.velocity_window * config.sensor.rate))
        self._past: deque[tuple[int, float]] = deque(maxlen=span + 1)
        self._force = Template(
            KeyForce(note=config.sensor.note), force="d", counts="i", saturated="?", sequence="I"
        )
        angle = KeyAngle(notes=[config.sensor.note], angle=[0.0], velocity=[0.0])
        self._angle = Template(angle, angle="d", velocity="d")
        self._driver = FsrDriver(config, self._publish, self.on_event)
        self._driver.connect()

    def diagnose(self) -> Mapping[str, Health]:
        """Link and sensor."""
        return self.health_of("fsr", self._driver)

    # Topics.

    def _publish(self, readings: list[FsrReading]) -> None:
        # On the driver's thread, so that a sample never waits for a callback of the executor.
        if not self._forces.is_activated:
            return
        for reading in readings:
            self._forces.publish(self._filled(reading))
            if (peak := self._follower.feed(reading)) is not None:
                self._peaks.publish(self._filled(peak))
            if self._angles is not None and reading.encoder is not None:
                angle = reading.encoder * self._rad
                velocity = self._slope(reading.own_ns, angle)
                if (reading.sequence % self._angle_every) == 0:
                    self._angles.publish(
                        self._angle.fill(reading.time_ns, angle=angle, velocity=velocity)
                    )

    def _filled(self, reading: FsrReading) -> bytes:
        return self._force.fill(
            reading.time_ns,
            force=reading.force,
            counts=reading.counts,
            saturated=reading.saturated,
            sequence=reading.sequence & 0xFFFFFFFF,
        )

    def _slope(self, time_ns: int, angle: float) -> float:
        """Angular velocity over the last few samples, rad/s, by the clock that took them."""
        past = self._past
        if past and not 0 < time_ns - past[-1][0] < 100_000_000:  # after a gap there is no slope
            past.clear()
        past.append((time_ns, angle))
        span = time_ns - past[0][0]
        return 1e9 * (angle - past[0][1]) / span if span else 0.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    return common.run(FsrReader, arguments, realtime=common.REALTIME_PRIORITY - 1)


if __name__ == "__main__":
    sys.exit(main())
