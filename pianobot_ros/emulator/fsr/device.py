"""``python -m pianobot_ros.emulator.fsr``: the emulated force sensor and key encoder, a process of
its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from pianobot_ros.cell.motion.geometry import keyboard
from pianobot_ros.devices.fsr import FsrCalibration, FsrConfig
from pianobot_ros.devices.serial_line import FSR_DEVICE, Identity, Line
from pianobot_ros.emulator.serving.bus import PlantBus
from pianobot_ros.emulator.serving.serial_device import SerialDevice, arguments_of, run_device
from pianobot_ros.emulator.serving.serial_port import SerialPort

__all__ = ["Fsr", "main"]

_FRAME = (
    0.008  # s: lines go out in bunches, as a USB bridge sends them (some hold lines back for 16 ms)
)
_AGE = (
    0.0016  # s from the last sample of a bunch to its sending; the plant's ticks come late by less
)
_IDLE = 0.02  # s between two looks at the command line while nothing streams
_PRESS_PERIOD, _PRESS_TIME, _PRESS_FORCE, _PRESS_ANGLE = (
    0.5,
    0.2,
    5.0,
    0.04,
)  # of the signal of a device that is alone


class Fsr(SerialDevice):
    """Samples of the plant's 1 kHz ring, or alone a press of 5 N twice a second, as converter and
    encoder counts.
    """

    def __init__(
        self,
        port: SerialPort,
        bus: PlantBus | None = None,
        config: FsrConfig | None = None,
        encoder: bool = True,
    ) -> None:
        config = config or FsrConfig.load()
        sensor = config.sensor
        features = {"bits": str(sensor.bits), "encoder": str(int(encoder))}
        super().__init__(port, Identity(FSR_DEVICE, "1.0-emulated", features=features))
        self._bus = bus
        self._calibration = FsrCalibration(
            config.calibration.counts, config.calibration.force, sensor.bits
        )
        board = keyboard()
        self._key = board.notes.index(sensor.note)
        self._counts_per_rad = config.encoder.resolution * board.white.pivot
        self._encoder = encoder
        self._rate = 0.0
        self._trim = 0.0
        self._index: int | None = None
        self._next = 0.0

    @property
    def period(self) -> float:
        """Seconds between two bunches."""
        return max(_FRAME, 1.0 / self._rate) + self._trim if self._rate else _IDLE

    def reboot(self) -> None:
        """After power-on nothing streams until a rate is set."""
        super().reboot()
        self._rate = 0.0

    def obey(self, line: Line) -> str | None:
        """``R`` sets the sample rate in Hz; 0 ends the stream."""
        if line.kind != "R":
            return f"unknown command {line.kind}"
        rate = int(line.fields[0])
        if not 0 <= rate <= 1000:
            return "rate out of range"
        self._rate = float(rate)
        self._next = 0.0
        self._trim = 0.0
        if self._bus is not None:
            self._index = self._bus.read_samples(None).next_index
        return None

    def measure(self, now: float) -> list[tuple[object, ...]]:
        """``F`` lines of the samples since the last bunch."""
        if not self._rate:
            return []
        return self._from_plant(now) if self._bus is not None else self._alone(now)

    def _from_plant(self, now: float) -> list[tuple[object, ...]]:
        """Samples older than ``_AGE``. A board samples and sends by one clock, so bunches keep step
        with their samples: the next bunch comes when its last sample has just that age.
        """
        assert self._bus is not None
        samples = self._bus.read_samples(self._index)
        self._index = samples.next_index
        step = 1.0 / self._rate
        lines = []
        self._trim = 0.0
        for i, t in enumerate(samples.time.tolist()):
            if t > now - _AGE + 1e-5:  # for the next bunch
                self._index -= len(samples.time) - i
                break
            if t < self._next - 1e-5:
                continue
            late = (now - _AGE - t + 1e-4) % step - 1e-4  # a little before the next one: negative
            self._trim = -late if abs(late) > 1e-5 else 0.0
            # The grid of wanted times goes on unless samples are missing.
            self._next = self._next + step if 0.0 <= t - self._next < step else t + step
            micros = round(float(samples.device_time[i]) * 1e6) & 0xFFFFFFFF
            lines.append(
                self._line(micros, float(samples.reading[i]), float(samples.angles[i, self._key]))
            )
        return lines

    def _alone(self, now: float) -> list[tuple[object, ...]]:
        step = 1.0 / self._rate
        if now - self._next > 1.0:
            self._next = now
        lines = []
        while self._next <= now:
            phase = ((self._next - self._boot) % _PRESS_PERIOD) / _PRESS_TIME
            press = math.sin(math.pi * phase) if phase < 1.0 else 0.0
            lines.append(
                self._line(self.micros(self._next), _PRESS_FORCE * press, _PRESS_ANGLE * press)
            )
            self._next += step
        return lines

    def _line(self, micros: int, force: float, angle: float) -> tuple[object, ...]:
        counts = min(max(self._calibration.counts(force), 0), self._calibration.top)
        if not self._encoder:
            return ("F", micros, counts)
        return ("F", micros, counts, round(angle * self._counts_per_rad))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until SIGINT or SIGTERM."""
    parser = arguments_of("fsr", __doc__)
    parser.add_argument("--no-encoder", action="store_true", help="the device has no key encoder")
    options = parser.parse_args(arguments)
    return run_device(
        "fsr", options, lambda port, bus: Fsr(port, bus, encoder=not options.no_encoder)
    )
