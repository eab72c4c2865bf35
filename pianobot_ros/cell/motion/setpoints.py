"""One setpoint of the wrist, as both cells are told it."""

from __future__ import annotations

from dataclasses import dataclass

from pianobot_ros.cell.arrays import Array

__all__ = ["WristSetpoint"]


@dataclass(frozen=True)
class WristSetpoint:
    """Wanted pose of the wrist frame in the base frame.

    Attributes:
        position: (3,), m.
        rotation: rotation vector, (3,), rad; zero in the playing pose.
        velocity: (6,), m/s and rad/s: velocity of the same motion, zero if unknown.
        stamp: when the setpoint was made, s on any clock that all setpoints of a stream share; 0 if
            unknown.
    """

    position: Array
    rotation: Array
    velocity: Array
    stamp: float = 0.0
