"""A spring at the joint: a cable, a hose, a harness or a return spring draws it to an angle."""

from __future__ import annotations

from numba import njit

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def law(q: float, stiffness: float, angle: float) -> float:
    """Torque (effort) that holds angle q against a spring that is slack at `angle`."""
    return stiffness * (q - angle) if stiffness != 0.0 else 0.0


def effect(s: Scales) -> Effect:
    """Stiffness (effort per rad) and the angle (rad) at which it is slack, within the travel or
    beside it.
    """
    soft = 2.0 * s.effort / max(s.travel, 1e-4)  # all of the effort at either end of the travel
    low, high = s.middle - 2.0 * s.travel, s.middle + 2.0 * s.travel
    return Effect(
        "spring",
        "load",
        [
            Parameter("spring", 0.0, 0.0, 20.0 * soft, f"{s.effort_unit}/rad", sd=soft),
            Parameter("spring_angle", s.middle, low, high, "rad", sd=0.5 * s.travel),
        ],
        [{"spring": share * soft} for share in (0.3, 1.0)],
        description="a cable, a hose or a return spring draws the joint to an angle",
        law=law,
    )
