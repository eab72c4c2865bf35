"""Vacuum levels of a set of strikes, and the side from which each was reached."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.numbers.shown import in_kpa
from pianobot_ros.piano.identify.takes.take import Take

__all__ = ["BOTH_SIDES", "Levels", "level_name", "side_name"]


LEVEL_WIDTH = 5e3  # Pa: pressures closer than this are one level
STEADY = 3e3  # Pa: vacuum that moves by more than this while the finger is on the key is no level
MOVED = 10e3  # Pa: a change of vacuum large enough to say from which side a level was reached
ENOUGH = 2  # strikes from either side that make the difference a parameter
BOTH_SIDES = "side_of_loading"


def level_name(pressure: float) -> str:
    """Name of the stiffness factor at a vacuum level (Pa)."""
    return f"joint_stiffness {in_kpa(pressure)}"


def side_name(pressure: float) -> str:
    """Name of the factor between a level (Pa) reached from less vacuum and the same on average."""
    return f"loading_stiffness {in_kpa(pressure)}"


class Levels:
    """Of ``takes``: ``pressures`` of the levels (Pa, most vacuum first); by take the pressure on
    the key ``at`` (Pa), whether it was ``steady``, its side in ``sides`` (1: vacuum was increased
    to it, -1: decreased, 0: it never moved) and its number of level ``of``; ``two_sided`` the
    levels with strikes from both.
    """

    def __init__(self, takes: Sequence[Take]) -> None:
        self._takes = takes
        during = [t.pressure_in_contact() for t in takes]
        self.at = [
            float(np.mean(p)) if np.isfinite(p).all() else float(t.strike.pressure)
            for t, p in zip(takes, during, strict=True)
        ]
        self.steady = [not np.ptp(p) > STEADY for p in during]
        chosen = [p for p, s in zip(self.at, self.steady, strict=True) if s] or self.at
        self.pressures = _clusters(sorted(chosen))
        self.of = [int(np.argmin(np.abs(np.array(self.pressures) - p))) for p in self.at]
        self.sides = self._sides()
        self.two_sided = [
            p
            for i, p in enumerate(self.pressures)
            if min(self.members(i, 1.0), self.members(i, -1.0), key=len)[ENOUGH - 1 :]
        ]

    def members(self, level: int, side: float | None = None) -> list[int]:
        """Numbers of the steady takes at a level, from one side or from any."""
        return [
            i
            for i, own in enumerate(self.of)
            if own == level and self.steady[i] and side in (None, self.sides[i])
        ]

    def _sides(self) -> list[float]:
        before: dict[str, float] = {}
        last: dict[str, float] = {}
        sides = [0.0] * len(self._takes)
        for i in sorted(range(len(sides)), key=lambda i: self._takes[i].strike.start):
            finger, now = self._takes[i].strike.finger, self.at[i]
            if abs(now - before.get(finger, now)) > MOVED:
                last[finger] = 1.0 if now < before[finger] else -1.0
            before[finger] = now
            sides[i] = last.get(finger, 0.0)
        return sides

    def factor(self, i: int, values: Mapping[str, float]) -> Array | float:
        """Factor on the calibrated stiffness over take i, (n,) or one number."""
        logs = [np.log(values[level_name(p)]) for p in self.pressures]
        side = self.sides[i]
        for k, p in enumerate(self.pressures):
            if side and (more := values.get(side_name(p))) is not None:
                logs[k] += side * np.log(more)
        pressure = self._takes[i].pressure
        return np.asarray(
            np.exp(np.interp(pressure if pressure.size else self.at[i], self.pressures, logs))
        )


def _clusters(values: Sequence[float]) -> list[float]:
    groups: list[list[float]] = []
    for value in values:
        if groups and value - groups[-1][-1] < LEVEL_WIDTH:
            groups[-1].append(value)
        else:
            groups.append([value])
    return [float(np.mean(group)) for group in groups]
