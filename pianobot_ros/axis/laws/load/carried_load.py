"""A load that is taken up and put down amid the log: the part that a gripper moves."""

from __future__ import annotations

import numpy as np

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.gap.problem.types import Array

G = 9.81  # m/s²
GRIPS = 0.2  # s in which a load is taken up or put down


REST = 0.5  # s by which the moment may be another than seems in each cycle
CYCLE = ("carried_start", "carried_period")
"""Begin and length of the first cycle, s, where the load is carried in each one."""


def share(t: Array, begins: float, ends: float, start: float = 0.0, period: float = 0.0) -> Array:
    """How much of the load is carried, 0 to 1, at times t (n,) since the log began, s; with a
    ``period`` likewise in each cycle from ``start`` on.
    """
    if period > 0.0:
        t = start + np.mod(t - start, period)
    up = np.clip((t - begins) / GRIPS + 0.5, 0.0, 1.0)
    down = np.clip((t - ends) / GRIPS + 0.5, 0.0, 1.0)
    return np.asarray(up - down)


def effect(s: Scales) -> Effect:
    """Its gravity (effort at the horizontal), the angle (rad; with other joints' that turn it) at
    which it hangs straight, its distance from the axis (m), and when it is carried (s).

    Mass times distance is gravity, and mass times its square is inertia.
    """
    e, last, when = s.effort, s.duration, 0.25 * s.duration
    found = {n: x for n, x in s.carried.items() if n not in CYCLE}
    begins, ends = found.get("carried_from", 0.0), found.get("carried_until", last)
    low, high, part = (-GRIPS, -GRIPS), (last + GRIPS, last + GRIPS), " of the log"
    if "carried_period" in s.carried:  # while the robot stands
        low, high = (begins - REST, ends - REST), (begins + REST, ends + REST)
        when, part = GRIPS, " of each cycle"
    return Effect(
        "carried_load",
        "load",
        [
            Parameter("carried_load", 0.0, 0.0, 20 * e, s.effort_unit, sd=e),
            Parameter("carried_angle", 0.0, -7.0, 7.0, "rad", sd=2.0),
            Parameter("carried_reach", 0.3, 0.0, 3.0, "m", sd=0.3),
            Parameter("carried_from", begins, low[0], high[0], "s", sd=when),
            Parameter("carried_until", ends, low[1], high[1], "s", sd=when),
        ],
        [{**found, "carried_load": k * found.get("carried_load", e)} for k in (1.0, 0.5)],
        description=f"a load that is carried for a part{part}",
    )
