"""Wrist motion: the hybrid sinusoidal up-down of "Data-driven Simulation Framework", III-C.

A strike goes down along half a cosine, may stay at the bottom, and comes up along half a cosine, so
that position and velocity are continuous and the peak speed is what was asked for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import ScoreError

__all__ = ["StrikeMotion"]


@dataclass(frozen=True)
class StrikeMotion:
    """Vertical wrist motion of one strike, relative to the height at which the fingertip touches
    the key at rest.

    Attributes: ``speed`` peak speed on the way down, m/s; ``depth`` travel below the touching
    height, m; ``hold`` time at the bottom, s; ``clearance`` start and end above the touching
    height, m; ``release_speed`` peak speed on the way up, m/s (0: as ``speed``).
    """

    speed: float
    depth: float
    hold: float
    clearance: float = 0.005
    release_speed: float = 0.0

    def __post_init__(self) -> None:
        for name in ("speed", "depth"):
            if not getattr(self, name) > 0:
                raise ScoreError(
                    f"{name} of a strike is {getattr(self, name)}: give a positive number"
                )
        if not (self.hold >= 0 and self.clearance >= 0 and self.release_speed >= 0):
            raise ScoreError("hold, clearance and release_speed of a strike must not be negative")

    @property
    def amplitude(self) -> float:
        """Whole travel, m."""
        return self.clearance + self.depth

    @property
    def down_time(self) -> float:
        """Duration of the way down, s: a half cosine of amplitude A has peak speed pi A / (2 T)."""
        return np.pi * self.amplitude / (2 * self.speed)

    @property
    def up_time(self) -> float:
        """Duration of the way up, s."""
        return np.pi * self.amplitude / (2 * (self.release_speed or self.speed))

    @property
    def duration(self) -> float:
        """Whole motion, s."""
        return self.down_time + self.hold + self.up_time

    def height(self, time: ArrayLike) -> Array:
        """Height above the touching height at ``time`` since the start of the motion (any shape,
        s), m.
        """
        t = np.asarray(time, dtype=float)
        down = 0.5 * (1 - np.cos(np.pi * np.clip(t / self.down_time, 0, 1)))
        up = 0.5 * (
            1 - np.cos(np.pi * np.clip((t - self.down_time - self.hold) / self.up_time, 0, 1))
        )
        return np.asarray(self.clearance - self.amplitude * (down - up))

    def velocity(self, time: ArrayLike) -> Array:
        """Vertical velocity at ``time`` (any shape, s), m/s, negative on the way down."""
        t = np.asarray(time, dtype=float)

        def bump(start: float, length: float) -> Array:
            phase = (t - start) / length
            inside = (phase > 0) & (phase < 1)
            return np.where(
                inside, 0.5 * np.pi / length * np.sin(np.pi * np.clip(phase, 0, 1)), 0.0
            )

        return np.asarray(
            -self.amplitude
            * (bump(0.0, self.down_time) - bump(self.down_time + self.hold, self.up_time))
        )
