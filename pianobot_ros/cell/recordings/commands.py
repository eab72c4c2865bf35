"""What both cells are told: the wrist's setpoints and the vacuum's, on one time axis."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.recordings.recording import Recording, Strike, TimeSeries

__all__ = ["CYCLE", "Commands"]


CYCLE = 0.008  # s, command cycle of a UR CB3 controller


@dataclass(frozen=True)
class Commands:
    """Setpoints; each holds until the next one.

    ``time`` (n,) s, ascending, with ``position`` (n, 3) m and ``rotation`` (n, 3) rotation vector
    rad of the wrist frame in the base frame; ``vacuum_time`` (m,) s with ``pressure`` (m, 3) Pa
    gauge in the order of thumb, index, middle; ``strikes`` with their windows; ``tail`` s for which
    the last setpoint holds after its time.
    """

    time: Array
    position: Array
    rotation: Array
    vacuum_time: Array = field(default_factory=lambda: np.zeros(1))
    pressure: Array = field(default_factory=lambda: np.zeros((1, 3)))
    strikes: tuple[Strike, ...] = ()
    tail: float = 0.0

    @property
    def duration(self) -> float:
        """From 0 s until the end, s."""
        return float(self.time[-1]) + self.tail

    @property
    def pose(self) -> Array:
        """Position and rotation side by side (n, 6)."""
        return np.hstack([self.position, self.rotation])

    def at_steps(self, step: float) -> Array:
        """The pose that holds at the start of each step of ``step`` s (k, 6), from 0 s on."""
        grid = (np.arange(round(self.duration / step)) + 1e-9) * step
        return np.asarray(
            self.pose[np.clip(np.searchsorted(self.time, grid, side="right") - 1, 0, None)]
        )

    def signals(self) -> dict[str, TimeSeries]:
        """As the signals ``command/…`` of a :class:`Recording`."""
        return {
            "command/wrist.position": TimeSeries(self.time, self.position, "m"),
            "command/wrist.rotation": TimeSeries(self.time, self.rotation, "rad"),
            "command/vacuum.pressure": TimeSeries(self.vacuum_time, self.pressure, "Pa"),
        }

    @classmethod
    def from_recording(cls, recording: Recording) -> Commands:
        """The commands of a recording. Raises :class:`RecordingError` if it has none."""
        position = recording.signal("command/wrist.position")
        rotation = recording.signals.get("command/wrist.rotation")
        turned = np.zeros_like(position.value) if rotation is None else rotation.value
        vacuum = recording.signals.get("command/vacuum.pressure")
        strikes = tuple(recording.strikes)
        if vacuum is None or not len(vacuum.time):
            return cls(position.time, position.value, turned, strikes=strikes)
        return cls(position.time, position.value, turned, vacuum.time, vacuum.value, strikes)
