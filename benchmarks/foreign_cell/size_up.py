"""How large an effect is: the largest RMS difference from the same cell without it, in floors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from foreign_cell.law_table import FAMILIES, Acting
from foreign_cell.whole_cell import UnstableError, play
from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.recordings.commands import Commands
from pianobot_ros.cell.recordings.recording import Recording

__all__ = ["FLOOR", "Size", "gaps", "observables", "size_up"]

FLOOR: Mapping[str, float] = {
    "wrist": 18e-6,
    "pressure": 82.0,
    "force": 0.034,
    "angle": 0.08e-3,
    "onset": 0.4e-3,
    "hold": 0.8e-3,
    "von": 0.5,
    "voff": 0.35,
}
"""Repeatability floors of ``docs/plant.md``: height of the wrist m, pressure Pa, force N, key angle
rad; of a note onset s, hold s, velocity of note-on and of note-off.
"""
NOTE = ("onset", "hold", "von", "voff")
TRIES = 9
CLOSE = 0.04  # relative error of a size that is good enough
AFTER = 0.1  # s after a strike in which its notes may still come


class Size(NamedTuple):
    """``strength`` of an effect by its family's unit, its size in ``floors``, and the observable
    where it is ``largest``.
    """

    strength: float
    floors: float
    largest: str


def observables(recording: Recording) -> dict[str, Array]:
    """The observables of ``FLOOR``: signals every 1 ms during the strikes, and note by strike."""
    grid = np.concatenate([np.arange(s.start, s.end, 1e-3) for s in recording.strikes])
    names = {
        "wrist": ("wrist/state.position", 2),
        "pressure": ("vacuum/state.measured", 2),
        "force": ("fsr.force", None),
        "angle": (f"key_angle.{recording.fsr_note}", None),
    }
    found = {}
    for name, (signal, column) in names.items():
        series = recording.signals[f"real/{signal}"]
        value = series.value if column is None else series.value[:, column]
        found[name] = np.interp(grid, series.time, value)
    rows = np.full((len(recording.strikes), len(NOTE)), np.nan)
    for i, strike in enumerate(recording.strikes):
        notes = recording.notes["real"]
        inside = [n for n in notes if strike.start <= n.time <= strike.end + AFTER]
        on = next((n for n in inside if n.on), None)
        off = next((n for n in inside if not n.on), None)
        if on and off:
            rows[i] = on.time - strike.start, off.time - on.time, on.velocity, off.velocity
    return found | {name: rows[:, k] for k, name in enumerate(NOTE)}


def gaps(one: Mapping[str, Array], other: Mapping[str, Array]) -> dict[str, float]:
    """RMS differences of observables in floors; of notes the most different tenth is left out."""
    found = {}
    for name, floor in FLOOR.items():
        squares = np.sort((one[name] - other[name]) ** 2)
        squares = squares[np.isfinite(squares)]
        if name in NOTE:
            squares = squares[: len(squares) - len(squares) // 10]
        found[name] = float(np.sqrt(squares.mean()) / floor) if len(squares) else 0.0
    return found


def size_up(
    commands: Commands,
    name: str,
    law: int,
    target: float,
    parameters: Mapping[str, float],
    seed: int,
) -> Size:
    """The strength at which the family ``name`` by ``law`` comes close to ``target`` floors in this
    cell, by secants on logarithmic scales.
    """

    def played(effects: Mapping[str, Acting]) -> dict[str, Array]:
        return observables(play(commands, effects, parameters, seed, 1.0, 0.0))

    base = played({})
    family = FAMILIES[name]
    strength, bound = family.start[law - 1], family.bound[law - 1]
    tried: list[tuple[float, float, float, str]] = []  # both logarithms, size, observable

    def distance(point: tuple[float, float, float, str]) -> float:
        return abs(point[1] - math.log(target))

    for _ in range(TRIES):
        try:
            found = gaps(played({name: Acting(law, strength)}), base)
        except UnstableError:
            bound = strength * 0.9
            strength *= 0.5
            continue
        largest = max(found, key=lambda observable: found[observable])
        size = found[largest]
        tried.append((math.log(strength), math.log(max(size, 1e-6)), size, largest))
        if abs(size / target - 1) < CLOSE or (strength >= bound and size < target):
            break
        near = sorted(tried, key=distance)[:2]
        slope = 1.0
        if len(near) == 2 and abs(near[0][0] - near[1][0]) > 1e-6:
            slope = (near[0][1] - near[1][1]) / (near[0][0] - near[1][0])
            slope = min(max(slope, 0.3), 4)
        aim = near[0][0] + (math.log(target) - near[0][1]) / slope
        strength = min(math.exp(aim), bound)
    best = min(tried, key=distance)
    return Size(math.exp(best[0]), best[2], best[3])
