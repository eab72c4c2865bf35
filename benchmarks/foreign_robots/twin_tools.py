"""What the four twins have in common."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter, savgol_filter

from pianobot_ros.gap import Block, Effect, Parameter

Array = NDArray[np.float64]
Made = TypeVar("Made")

MOST_BLOCKS = 400


class BlockCache(Generic[Made]):
    """What ``make`` computes of a block, once for each. It is empty in another process."""

    def __init__(self, make: Callable[[Block], Made]) -> None:
        self.make = make
        self.kept: dict[int, tuple[Block, Made]] = {}

    def __call__(self, block: Block) -> Made:
        got = self.kept.get(id(block))
        if got is None or got[0] is not block:
            if len(self.kept) > MOST_BLOCKS:
                self.kept.clear()
            got = self.kept[id(block)] = (block, self.make(block))
        return got[1]

    def __getstate__(self) -> dict[str, object]:
        return {"make": self.make, "kept": {}}


def smoothed(y: Array, dt: float, order: int = 0, window: int = 15, degree: int = 4) -> Array:
    """``y`` or its derivative of that order (Savitzky and Golay 1964); ``dt`` in s."""
    return np.asarray(savgol_filter(y, window, degree, deriv=order, delta=dt))


def lagged(y: Array, dt: float, tau: float) -> Array:
    """First-order lag of ``tau`` s, by the mean of both ends of a sample; settled at first."""
    if tau <= 0:
        return y
    a = 1 - math.exp(-dt / tau)
    return np.asarray(lfilter([a / 2, a / 2], [1, a - 1], y, zi=[(1 - a / 2) * y[0]])[0])


def nuisance(name: str, nominal: float, unit: str, stage: str, sd: float = 0.1) -> Parameter:
    """A parameter above 0 that may be a quarter to four times its nominal value."""
    return Parameter(name, nominal, nominal / 4, nominal * 4, unit, stage, sd=sd, log=True)


def magnitude(name: str, sd: float, top: float, unit: str, signed: bool = False) -> Parameter:
    """The size of an effect, which vanishes at 0."""
    return Parameter(name, 0.0, -top if signed else 0.0, top, unit, sd=sd)


def effect(
    name: str,
    stage: str,
    size: Parameter,
    starts: Sequence[float],
    text: str,
) -> Effect:
    """An effect of one parameter."""
    return Effect(name, stage, [size], [{size.name: x} for x in starts], description=text)


def packed(values: Mapping[str, float], *names: str) -> Array:
    """Values by name as compiled code takes them; 0 for those that are not there."""
    return np.array([values.get(n, 0.0) for n in names])
