"""What of the following error is only that the joint is late."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize_scalar

from pianobot_ros.axis.signals.cleaning import Clean
from pianobot_ros.gap.problem.types import Array

__all__ = ["beyond_delay"]
LATEST, APART = 0.6, 0.05
"""s; the longest delay that a position may have of its command, and how far apart delays are tried
first.
"""


def beyond_delay(c: Clean) -> Array:
    """Following error (n,) of a log with a command that is delayed by as much as fits best.

    A slow loop, a bus and a hobby servo are late by a tenth of a second and more, and that is most
    of the following error. It tells nothing of the joint's load and friction, and every twin has
    it, however little else it resembles the joint.
    """
    assert c.command is not None
    command = c.command

    def left(delay: float) -> Array:
        return np.asarray(np.interp(c.t - delay, c.t, command) - c.position)

    def size(delay: float) -> float:
        return float(np.mean(left(delay)[c.valid] ** 2))

    first = min(np.arange(0.0, LATEST, APART).tolist(), key=size)
    bounds = (max(first - APART, 0.0), first + APART)
    return left(float(minimize_scalar(size, bounds=bounds, method="bounded").x))
