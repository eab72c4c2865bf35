"""``python -m pianobot_ros.emulator.vacuum``: the emulated vacuum regulator, a process of its
own on a pseudo-terminal.
"""

from __future__ import annotations

from collections.abc import Sequence

from pianobot_ros.devices.serial_line import REGULATOR_DEVICE, Identity, Line
from pianobot_ros.emulator.plant.instruments.pneumatics import RegulatorModel
from pianobot_ros.emulator.serving.bus import PlantBus
from pianobot_ros.emulator.serving.serial_device import SerialDevice, arguments_of, run_device
from pianobot_ros.emulator.serving.serial_port import SerialPort

__all__ = ["RATE", "Regulator", "main"]

RATE = 100.0  # Hz of the reports
_CHANNELS = 3
_LOWEST, _HIGHEST = -101_325, 0  # Pa that the hardware could do


class Regulator(SerialDevice):
    """Three channels. Without a host for the time set with ``W`` it vents."""

    def __init__(self, port: SerialPort, bus: PlantBus | None = None) -> None:
        super().__init__(
            port, Identity(REGULATOR_DEVICE, "1.0-emulated", features={"channels": str(_CHANNELS)})
        )
        self._bus = bus
        self._model = RegulatorModel() if bus is None else RegulatorModel.from_bus(bus)
        self._model.step(
            1.0 / RATE, (0.0,) * _CHANNELS
        )  # loads the compiled code, which must not make a report late
        self.setpoint = [0] * _CHANNELS
        self._vent_after = 0.0
        self._heard = 0.0
        self._now = 0.0
        self.vents = 0

    @property
    def period(self) -> float:
        """Seconds between two reports."""
        return 1.0 / RATE

    def reboot(self) -> None:
        """Without supply the valves close and the fingers vent."""
        super().reboot()
        self.setpoint = [0] * _CHANNELS
        self._vent_after = 0.0

    def measure(self, now: float) -> list[tuple[object, ...]]:
        """Step the pneumatics; one ``P`` line."""
        self._now = now
        if self._vent_after and now - self._heard > self._vent_after and any(self.setpoint):
            self.setpoint = [0] * _CHANNELS
            self.vents += 1
        measured = self._model.step(1.0 / RATE, self.setpoint)
        if self._bus is not None:
            self._bus.write_pressure(now, self._model.pressure)
        return [("P", self.micros(now), *self.setpoint, *(round(float(p)) for p in measured))]

    def obey(self, line: Line) -> str | None:
        """``S`` setpoints, ``W`` vent time, ``N`` sign of life."""
        self._heard = self._now
        if line.kind == "S":
            wanted = [int(text) for text in line.fields]
            if len(wanted) != _CHANNELS:
                return f"S needs {_CHANNELS} pressures"
            if not all(_LOWEST <= p <= _HIGHEST for p in wanted):
                return "pressure out of range"
            self.setpoint = wanted
        elif line.kind == "W":
            milliseconds = int(line.fields[0])
            if not 0 <= milliseconds <= 60_000:
                return "time out of range"
            self._vent_after = 1e-3 * milliseconds
        elif line.kind != "N":
            return f"unknown command {line.kind}"
        return None

    def status(self) -> dict[str, object]:
        """With setpoint, true pressure and how often it vented for want of a host."""
        return {
            **super().status(),
            "setpoint": self.setpoint,
            "pressure": [float(p) for p in self._model.pressure],
            "vents": self.vents,
        }


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until SIGINT or SIGTERM."""
    options = arguments_of("vacuum", __doc__).parse_args(arguments)
    return run_device("vacuum", options, Regulator)
