"""When scatter between repeats is more than chance: repeats may change places.

Repeats that nothing known sets apart are exchangeable. What follows from the session's time is
therefore tested by exchanging them (Fisher 1935, *The design of experiments*, 21).
"""

from __future__ import annotations

import numpy as np

from pianobot_ros.gap.problem.constants import CHANCE
from pianobot_ros.gap.problem.problem import Index
from pianobot_ros.gap.problem.types import Array

__all__ = ["more_than_chance", "orders", "standardised"]

DRAWS = round(1.0 / CHANCE) - 1
"""Draws of chance of which none may be as extreme as what was seen."""


def orders(count: int, rng: np.random.Generator) -> Index:
    """Random orders (draws, count) of so many repeats, the true one first."""
    base = np.tile(np.arange(count), (DRAWS, 1))
    return np.vstack([np.arange(count), rng.permuted(base, axis=1)])


def more_than_chance(statistic: Array) -> bool:
    """Whether the first of these statistics (1 + draws,) is larger than all that chance drew."""
    return bool(statistic[0] > statistic[1:].max())


def standardised(share: Array) -> Array:
    """A share (1 + draws,) in standard deviations of what chance drew, from its mean."""
    drawn = share[1:]
    return np.asarray((share - drawn.mean()) / max(float(drawn.std()), 1e-9))
