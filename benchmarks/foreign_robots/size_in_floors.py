"""How large a law of a plant is: by how much it moves what is measured, in units of the scatter of
repeats (floors). Nothing of a robot in here.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from foreign_robots.plant_tools import PlantLaw
from foreign_robots.twin_tools import Array
from pianobot_ros.gap import Block, Twin

HALVINGS = 11
NUDGE = 0.3  # of a prior's standard deviation
WEIGHT = 15.0  # of an rms residual of one floor against a prior's standard deviation
BEYOND_ALL = 1e9


class Sized(NamedTuple):
    """A size in floors and the observable that moves most."""

    floors: float
    observable: str


class Robot(NamedTuple):
    """A twin (made anew for each case), the laws of its plant, and what records blocks of it: by
    parameters, sizes of the laws and a seed.
    """

    twin: Callable[[], Twin]
    laws: Mapping[str, PlantLaw]
    record: Callable[[Mapping[str, float], Mapping[str, float], int], list[Block]]


def nominal_values(twin: Twin) -> dict[str, float]:
    """The twin's parameters as they are believed."""
    return {p.name: p.nominal for p in twin.parameters}


def residuals(twin: Twin, blocks: Sequence[Block], values: Mapping[str, float]) -> dict[str, Array]:
    """By observable what is measured less what the twin predicts, (blocks, samples)."""
    out: dict[str, list[Array]] = {o.name: [] for o in twin.observables}
    for block, predicted in zip(blocks, twin.simulate(blocks, values, ()), strict=True):
        for o in twin.observables:
            measured = (
                block.events.get(o.signal, np.nan)
                if o.kind == "event"
                else block.outputs[o.signal].y
            )
            left = np.asarray(measured, float) - np.asarray(predicted.get(o.name, np.nan), float)
            out[o.name].append(np.atleast_1d(left))
    return {name: np.array(rows) for name, rows in out.items()}


def floors_of(twin: Twin, blocks: Sequence[Block], left: Mapping[str, Array]) -> dict[str, float]:
    """By observable the standard deviation of repeats of a condition, or what is believable."""
    condition = np.array([b.condition for b in blocks])
    groups = np.unique(condition)
    out = {}
    for o in twin.observables:
        rows = left[o.name]
        with warnings.catch_warnings():  # samples that the twin leaves out have no variance
            warnings.simplefilter("ignore", RuntimeWarning)
            variances = [np.nanvar(rows[condition == c], axis=0, ddof=1) for c in groups]
        scatter = float(np.sqrt(np.nanmean(np.concatenate(variances))))
        out[o.name] = max(scatter, o.floor_hint)
    return out


def rms(x: Array) -> float:
    """Root of the mean square of what is there; 0 of nothing."""
    return float(np.sqrt(np.nanmean(np.square(x)))) if np.isfinite(x).any() else 0.0


class SizeInFloors:
    """Sizes of a robot's laws at some parameters, noise of one seed alike with and without."""

    def __init__(
        self, robot: Robot, twin: Twin, parameters: Mapping[str, float], seed: int
    ) -> None:
        self.robot, self.twin, self.parameters, self.seed = robot, twin, parameters, seed
        self.values = nominal_values(twin)
        self.blocks = robot.record(parameters, {}, seed)
        self.without = residuals(twin, self.blocks, self.values)
        self.floors = floors_of(twin, self.blocks, self.without)

    def moved(self, law: str, size: float) -> dict[str, Array]:
        """By observable what the law moves."""
        blocks = self.robot.record(self.parameters, {law: size}, self.seed)
        left = residuals(self.twin, blocks, self.values)
        return {name: left[name] - self.without[name] for name in left}

    def of(self, law: str, size: float) -> Sized:
        """The largest over the observables. A plant that runs away cannot be smoothed."""
        try:
            moved = self.moved(law, size)
        except ValueError:
            return Sized(BEYOND_ALL, "nan")
        ratio = {name: rms(d) / self.floors[name] for name, d in moved.items()}
        most = max(ratio, key=lambda name: ratio[name])
        return Sized(ratio[most], most)

    def solve(self, law: str, floors: float) -> tuple[float, Sized]:
        """The law's size that is so many floors, by halving in its range, and what it comes to."""
        low, high = math.log(self.robot.laws[law].low), math.log(self.robot.laws[law].high)
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            if self.of(law, math.exp(middle)).floors < floors:
                low = middle
            else:
                high = middle
        size = math.exp((low + high) / 2)
        return size, self.of(law, size)

    def beyond_refit(self, law: str, size: float) -> Sized:
        """What is left once the parameters, linearised and held by their priors, follow."""
        moved = self.moved(law, size)
        base = residuals(self.twin, self.blocks, self.values)
        columns = []
        for p in self.twin.parameters:
            values = dict(self.values)
            nudged = p.nominal * math.exp(NUDGE * p.sd) if p.log else p.nominal + NUDGE * p.sd
            values[p.name] = nudged
            left = residuals(self.twin, self.blocks, values)
            columns.append(self._row({name: (left[name] - base[name]) / NUDGE for name in left}))
        jacobian, row = np.array(columns).T, self._row(moved)
        count = jacobian.shape[1]
        held = np.vstack([jacobian * WEIGHT, np.eye(count)])
        asked = np.concatenate([row * WEIGHT, np.zeros(count)])
        beyond = row - jacobian @ np.linalg.lstsq(held, asked, rcond=None)[0]
        out, place = {}, 0
        for name, d in moved.items():
            out[name] = float(np.sqrt(np.sum(beyond[place : place + d.size] ** 2)))
            place += d.size
        most = max(out, key=lambda name: out[name])
        return Sized(out[most], most)

    def _row(self, moved: Mapping[str, Array]) -> Array:
        """All observables in one row whose squares add up to the squares of rms in floors."""
        return np.concatenate(
            [
                np.nan_to_num(d).ravel()
                / self.floors[name]
                / math.sqrt(max(1, np.isfinite(d).sum()))
                for name, d in moved.items()
            ]
        )
