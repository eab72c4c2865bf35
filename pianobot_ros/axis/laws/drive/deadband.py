"""Deadband of the position controller: errors smaller than half of it are not corrected."""

from __future__ import annotations

from numba import njit

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def law(error: float, width: float) -> float:
    """Error that the controller sees, rad."""
    half = 0.5 * width
    if error > half:
        return error - half
    if error < -half:
        return error + half
    return 0.0


def effect(s: Scales) -> Effect:
    """Full width, rad."""
    e = max(s.error, 1e-5)
    return Effect.of_size(
        Parameter("deadband", 0.0, 0.0, max(6 * e, 0.05), "rad", "drive", sd=e),
        [x * e for x in (0.3, 1.0, 2.5)],
        "the controller ignores small errors",
        law=law,
    )
