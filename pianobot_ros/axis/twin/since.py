"""What a reference log determined of a joint: that is known of it in the next log, in which only
what a load may change has changed, and dry friction, which is never the same.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from pianobot_ros.gap import Parameter
from pianobot_ros.gap.diagnosis import Estimate

__all__ = ["Since"]

INERTIA, GRAVITY, ANGLE = math.log(1.1), 0.03, 0.03
"""What stays open of inertia (log), of a gravity (share), also by a model of the robot, and of the
angle (rad) at which it hangs, however well the reference determined them: the twin is no exact
copy.
"""
SURE = 2.0 / 1.96
"""Of half a 95 % interval, what stays open of a value that the reference determined worse."""
WORN = 0.5
"""Share by which dry friction may have changed: it goes with temperature, load and wear, and from a
cold to a warm joint by about as much (Bittencourt and Gunnarsson 2012, Journal of Dynamic Systems,
Measurement, and Control 134). More of it is another value, not another law.
"""
OF_FRICTION = (
    "coulomb",
    "stribeck_level",
    "load_friction_level",
    "asymmetric_level",
    "hysteresis",
)
OF_LOAD = ("gravity", "arm_gravity", "arm_own", "spring")
WEIGHT = "effort_offset"
"""A constant load, which is the gravity of a linear joint."""
OF_ANGLE = ("gravity_angle", "arm_angle", "arm_own_angle")


@dataclass(frozen=True)
class Since:
    """What is known from a reference.

    `estimates` are the posterior of the twin's own parameters there, `arm` the joints that turn its
    gravity, `missed` the RMS that the twin left of each observable, which is no change.
    """

    estimates: Mapping[str, Estimate]
    arm: Mapping[str, float]
    missed: Mapping[str, float]

    def known(self, p: Parameter, has_effort: bool, linear: bool) -> Parameter:
        """A parameter with what the reference says of it. An added mass shows as inertia and
        gravity, so what the machine itself has of these stays within what the reference left open;
        without efforts the bandwidth is the inertia, and the gravity of a `linear` joint is a
        constant load. Dry friction may be another. Of all else the prior has the reference's value,
        and is as wide as that is open.
        """
        if p.name in OF_FRICTION:
            return replace(p, sd=max(p.sd, WORN * abs(p.nominal)))
        e = self.estimates.get(p.name)
        carried = {"inertia": INERTIA, "model_scale": GRAVITY}
        if not has_effort:
            carried["bandwidth"] = 0.5 * INERTIA
        if e is None:
            return p
        value, left = _left_open(p, e)
        weight = p.name == WEIGHT and linear
        if p.name not in (*carried, *OF_LOAD, *OF_ANGLE) and not weight:
            return replace(p, nominal=value, sd=max(p.sd, 0.5 * left))
        if p.name in carried:
            half = max(carried[p.name], left)
            low, high, sd = value * math.exp(-half), value * math.exp(half), 0.5 * half
        else:
            least = ANGLE if p.name in OF_ANGLE else GRAVITY * abs(value)
            half = max(least, left, p.sd if weight else 1e-12)
            low, high, sd = value - half, value + half, 0.5 * half
        low, high = max(low, p.low), min(high, p.high)
        return replace(p, nominal=value, low=low, high=high, sd=sd)


def _left_open(p: Parameter, e: Estimate) -> tuple[float, float]:
    """The reference's value of a parameter, and how far to both sides that leaves it open, on the
    scale of its prior.
    """
    value = min(max(e.value, p.low), p.high)
    low, high = e.by_chance  # what the twin is wrong by is the same in both logs
    wide = math.log(max(high, value) / max(low, p.low)) if p.log else high - low
    return value, SURE * 0.5 * wide
