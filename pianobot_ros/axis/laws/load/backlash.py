"""Backlash: after a reversal the motor crosses a gap before it drives the load again.

The load is a mass that is pushed by one flank of the gap or the other, or moves between them under
its own field (gravity) and its own part of the dry friction. Flanks are springs that only push;
without a gap the spring pulls too (`elasticity`).
"""

from __future__ import annotations

import math

from numba import njit

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def pull(twist: float, speed: float, half: float, period: float, damping: float) -> float:
    """Acceleration (rad/s²) of a load that the motor is ahead of by `twist` rad and its rate
    `speed` rad/s.

    `half` is half the gap (rad), `period` (s) and `damping` (ratio) those of the load on its spring
    with the motor held.
    """
    w = 2.0 * math.pi / period
    if half == 0.0:
        return w * w * twist + 2.0 * damping * w * speed
    beyond = twist - half if twist > half else (twist + half if twist < -half else 0.0)
    push = w * w * beyond + 2.0 * damping * w * speed
    return push if push * beyond > 0.0 else 0.0


def effect(s: Scales) -> Effect:
    """Width of the gap (rad), the load's share of the inertia, encoder (0 motor, 1 output), period
    on a flank (s), and the load's share of the dry friction.
    """
    d = max(s.travel, 1e-4)
    return Effect(
        "backlash",
        "transmission",
        [
            Parameter("backlash", 0.0, 0.0, 0.5 * d, "rad", sd=0.02 * d),
            Parameter("backlash_share", 0.5, 0.05, 0.95, "1", sd=0.2),
            Parameter("backlash_output", 0.0, 0.0, 1.0, "1", sd=0.5),
            Parameter("backlash_flank", 0.02, 0.004, 0.2, "s", sd=0.7, log=True),
            Parameter("backlash_friction", 0.2, 0.0, 1.0, "1", sd=0.3),
        ],
        [
            {
                "backlash": width * d,
                "backlash_share": 0.5,
                "backlash_output": output,
                "backlash_flank": 0.02,
            }
            for width in (0.003, 0.007, 0.015, 0.03, 0.06)
            for output in (0.0, 1.0)
        ],
        description="lost motion after a reversal",
        law=pull,
    )
