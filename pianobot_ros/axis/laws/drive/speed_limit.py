"""Speed limit: the supply's voltage leaves the less torque the faster the motor already turns."""

from __future__ import annotations

from numba import njit

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def law(effort: float, v: float, loss: float, stall: float) -> float:
    """Effort that is left at speed v of a motor that gives `stall` at rest and loses the share
    `loss` of it for each rad/s.
    """
    high, low = stall * max(1.0 - loss * v, 0.0), -stall * max(1.0 + loss * v, 0.0)
    return min(max(effort, low), high)


def effect(s: Scales) -> Effect:
    """Share of the effort that is lost for each rad/s (the inverse of the speed without load), and
    the share of the peak demand that is lacking at rest: a torque limit is left where no speed
    takes any of it.
    """
    top = max(s.top_speed, 1e-6)
    return Effect(
        "speed_limit",
        "drive",
        [
            Parameter("speed_limit", 0.0, 0.0, 1.0 / top, "s/rad", sd=0.3 / top),
            Parameter("speed_limit_depth", 0.0, -0.5, 0.95, "1", sd=0.3),
        ],
        [
            {"speed_limit": loss / top, "speed_limit_depth": depth}
            for loss, depth in ((0.3, 0.0), (0.7, 0.0), (0.7, 0.6), (0.9, 0.8))
        ],
        description="the supply leaves less torque the faster the motor turns",
        law=law,
        remainder=("torque_limit", {"torque_limit": "speed_limit_depth"}),
    )
