"""Driving forces that are straight between breakpoints and may jump at them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pianobot_ros.cell.errors import ConfigError

__all__ = ["ForceProfile"]


@dataclass(frozen=True)
class ForceProfile:
    """Force [N] on the armature through the points (``times`` [s], ``forces`` [N]); two points at
    one time are a jump.

    Zero before the first point, constant after the last. Raises :class:`ConfigError` if the times
    fall back.
    """

    times: tuple[float, ...]
    forces: tuple[float, ...]

    def __post_init__(self) -> None:
        if not self.times or len(self.times) != len(self.forces):
            raise ConfigError(
                "a force profile needs as many times as forces, and at least one of each"
            )
        if any(b < a for a, b in zip(self.times, self.times[1:], strict=False)):
            raise ConfigError("the times of a force profile must not fall back")

    @classmethod
    def step(cls, force: float, at: float = 0.0) -> ForceProfile:
        """A step to ``force`` [N] at the time ``at`` [s]."""
        return cls((at,), (force,))

    @classmethod
    def steps(cls, points: Sequence[tuple[float, float]]) -> ForceProfile:
        """Steps to each force [N] at each time [s], given as (time, force)."""
        times: list[float] = []
        forces: list[float] = []
        level = 0.0
        for time, force in points:
            times += [time, time]
            forces += [level, force]
            level = force
        return cls(tuple(times), tuple(forces))

    def pieces(self, end: float) -> list[tuple[float, float, float, float]]:
        """(start, stop, force at start, slope) of every straight piece from 0 to ``end`` [s]."""
        out: list[tuple[float, float, float, float]] = []
        if self.times[0] > 0:
            out.append((0.0, min(self.times[0], end), 0.0, 0.0))
        for i, (start, force) in enumerate(zip(self.times, self.forces, strict=True)):
            last = i == len(self.times) - 1
            stop = end if last else min(self.times[i + 1], end)
            if stop <= start or stop <= 0:
                continue
            slope = 0.0 if last else (self.forces[i + 1] - force) / (self.times[i + 1] - start)
            begin = max(start, 0.0)
            out.append((begin, stop, force + slope * (begin - start), slope))
        return out
