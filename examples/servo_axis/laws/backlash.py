"""Backlash: after a reversal the motor crosses a gap before it drives the load again."""

from __future__ import annotations

from numba import njit

from examples.servo_axis.laws.base import Scales, effect
from pianobot_ros.gap import Effect, Parameter


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def play(follower: float, leader: float, width: float) -> float:
    """Position of the follower in the gap after the leader moved."""
    half = 0.5 * width
    if leader - follower > half:
        return leader - half
    if leader - follower < -half:
        return leader + half
    return follower


def build(s: Scales) -> Effect:
    """Full width of the gap, rad."""
    d = max(s.travel, 1e-4)
    return effect("backlash", "transmission",
                  [Parameter("backlash", 0.0, 0.0, 0.5 * d, "rad", "transmission", sd=0.02 * d)],
                  [[0.003 * d], [0.015 * d], [0.06 * d]], "lost motion after a reversal")  # fmt: skip
