"""Gravity of an imbalance or a payload: effort that follows the sine of the angle."""

from __future__ import annotations

import math

from numba import njit

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def law(q: float, amplitude: float, angle: float) -> float:
    """Holding torque at angle q, effort units."""
    return amplitude * math.sin(q - angle) if amplitude != 0.0 else 0.0


def effect(s: Scales) -> Effect:
    """Amplitude (effort at the horizontal) and the angle at which it hangs straight."""
    e = s.effort
    return Effect(
        "gravity",
        "load",
        [
            Parameter("gravity", 0.0, 0.0, 20 * e, s.effort_unit, sd=e),
            Parameter("gravity_angle", 0.0, -4.0, 4.0, "rad", sd=2.0),
        ],
        [{"gravity": 0.3 * e, "gravity_angle": a} for a in (-2.36, -0.79, 0.79, 2.36)]
        + [{"gravity": e, "gravity_angle": a} for a in (-3.1, -1.57, 0.0, 1.57)],
        description="a payload or imbalance pulls with gravity",
        law=law,
    )
