"""Sensor noise and wander of the emulated cell (``config/plant.yaml: noise``)."""

from __future__ import annotations

from pianobot_ros.cell.numbers.config import Section, configured, quantity

__all__ = ["SensorNoise", "noise_levels"]


class SensorNoise(Section):
    """Standard deviations and resolutions."""

    wrist_position: float = quantity("m", low=0)
    wrist_rotation: float = quantity("rad", low=0)
    wrist_wander: float = quantity("m", low=0)
    pressure: float = quantity("Pa", low=0)
    fsr: float = quantity("N", low=0)
    fsr_gain_spread: float = quantity("1", low=0)
    midi_time: float = quantity("s", low=0)
    midi_velocity: float = quantity("1", low=0)


noise_levels = configured("plant.yaml", SensorNoise, "noise")
"""The noise of the configuration in force."""
