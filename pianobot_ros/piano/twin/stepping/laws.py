"""What departs from the nominal laws while the twin runs, as the twin sees it; who knows the
effects provides it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from pianobot_ros.cell.arrays import Array

__all__ = ["Laws"]


class Laws(Protocol):
    """Departures from the nominal cell, with the memory that they have.

    ``parameters`` factors by name; ``numbers`` of the mechanical laws (``strike_laws.py``);
    ``feeling``: within how many s the wrist must feel the contact force (inf: it does not);
    ``wrist``, ``vacuum``, ``reading``: whether wrist, vacuum and force sensor depart at all.
    Signals come in pieces, in order of time.
    """

    parameters: Mapping[str, float]
    numbers: Mapping[str, float]
    feeling: float
    wrist: bool
    vacuum: bool
    reading: bool

    def reset(self) -> None:
        """Forget what was: the session begins now."""

    def height(self, t: Array, z: Array, force: float) -> Array:
        """Height (n,) m of the wrist at times (n,) s, where the servo has it at z (n,); ``force``
        N on the wrist.
        """

    def pressure(self, t: Array, setpoint: Array) -> Array:
        """Pressure (3,) Pa at the last of the times (n,) s; the setpoint (3,) held through them."""

    def stiffness(self, pressure: Array) -> Array:
        """Factors (3,) on the fingers' stiffness at this pressure (3,) Pa."""

    def read(self, key: int, t: Array, force: Array) -> Array:
        """Reading (n,) N of a sensor on the key number ``key`` under a force (n,) N."""

    def velocity(self, x: float) -> float:
        """MIDI velocity, not yet rounded, where the nominal one is x."""

    def triggers(self) -> tuple[float, float]:
        """Shifts of the angles at which notes begin and end, rad."""

    def late(self) -> float:
        """How late the next note event is, s."""
