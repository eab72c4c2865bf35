"""Hysteresis (Dahl): after a reversal a friction builds up over a share of the travel, as in
cables, belts and rubber; far more than the contact of dry friction bends by (see `presliding.py`).
"""

from __future__ import annotations

from numba import njit

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def advance(z: float, dq: float, distance: float) -> float:
    """State (-1 to 1) after moving by dq: z relaxes towards the direction of motion over
    `distance`.
    """
    if distance <= 0.0 or dq == 0.0:
        return z
    step = abs(dq) / distance
    target = 1.0 if dq > 0 else -1.0
    return target + (z - target) / (1.0 + step + 0.5 * step * step)


def effect(s: Scales) -> Effect:
    """Level and the distance (rad) over which it builds up."""
    e, d = s.effort, max(s.travel, 1e-4)
    return Effect(
        "hysteresis",
        "mechanics",
        [
            Parameter("hysteresis", 0.0, 0.0, 5 * e, s.effort_unit, sd=0.3 * e),
            Parameter(
                "hysteresis_distance",
                0.05 * d,
                0.005 * d,
                0.6 * d,
                "rad",
                sd=0.8,
                log=True,
            ),
        ],
        [
            {"hysteresis": level * e, "hysteresis_distance": distance * d}
            for level, distance in ((0.1, 0.03), (0.3, 0.1), (0.3, 0.03))
        ],
        description="effort that lags behind a reversal",
        law=advance,
    )
