"""What of the following error is only that the joint is late."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize_scalar

from pianobot_ros.axis.signals.cleaning import Clean
from pianobot_ros.gap.problem.types import Array

__all__ = ["beyond_delay", "late_by", "lateness"]
LATEST, APART = 0.6, 0.05
"""s; the longest delay that a position may have of its command, and how far apart delays are tried
first.
"""
MOSTLY = 0.9
"""Share of the following error's power from which a joint is said to be late rather than off."""


def beyond_delay(c: Clean) -> Array:
    """Following error (n,) of a log with a command that is delayed by as much as fits best.

    A slow loop, a bus and a hobby servo are late by a tenth of a second and more, and that is most
    of the following error. It tells nothing of the joint's load and friction, and every twin has
    it, however little else it resembles the joint.
    """
    return _left(c, late_by(c))


def late_by(c: Clean) -> float:
    """Delay (s) with which the command of a log comes nearest to the position."""

    def size(delay: float) -> float:
        return float(np.mean(_left(c, delay)[c.valid] ** 2))

    first = min(np.arange(0.0, LATEST, APART).tolist(), key=size)
    bounds = (max(first - APART, 0.0), first + APART)
    return float(minimize_scalar(size, bounds=bounds, method="bounded").x)


def lateness(logs: Sequence[Clean]) -> str | None:
    """What to say of logs whose following error is mostly lateness; None of others."""
    known = [c for c in logs if c.command is not None]
    if not known:
        return None
    late = float(np.median([late_by(c) for c in known]))
    error, left = (
        sum(float(np.mean(_left(c, by)[c.valid] ** 2)) for c in known) for by in (0.0, late)
    )
    if error - left < MOSTLY * error or late < 2.0 * known[0].dt:
        return None
    return (
        f"the position comes {late:.2g} s after its command, which is most of the following error:"
        " the twin has that as a slow loop, unless a command_delay is named; only faster motion"
        " tells these apart"
    )


def _left(c: Clean, delay: float) -> Array:
    assert c.command is not None
    return np.asarray(np.interp(c.t - delay, c.t, c.command) - c.position)
