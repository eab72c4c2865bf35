"""A load that is taken up and put down amid the log: the part that a gripper moves."""

from __future__ import annotations

import numpy as np

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.gap.problem.types import Array

G = 9.81  # m/s²
GRIPS = 0.2  # s in which a load is taken up or put down


def share(t: Array, begins: float, ends: float) -> Array:
    """How much of the load is carried, 0 to 1, at times t (n,) since the log began, s."""
    up = np.clip((t - begins) / GRIPS + 0.5, 0.0, 1.0)
    down = np.clip((t - ends) / GRIPS + 0.5, 0.0, 1.0)
    return np.asarray(up - down)


def effect(s: Scales) -> Effect:
    """Its gravity (effort at the horizontal), the angle (rad; with other joints' that turn it) at
    which it hangs straight, its distance from the axis (m), and when it is carried (s).

    Mass times distance is gravity, and mass times its square is inertia.
    """
    e, last = s.effort, s.duration
    return Effect(
        "carried_load",
        "load",
        [
            Parameter("carried_load", 0.0, 0.0, 20 * e, s.effort_unit, sd=e),
            Parameter("carried_angle", 0.0, -7.0, 7.0, "rad", sd=2.0),
            Parameter("carried_reach", 0.3, 0.0, 3.0, "m", sd=0.3),
            Parameter("carried_from", 0.0, -GRIPS, last + GRIPS, "s", sd=0.25 * last),
            Parameter("carried_until", last, -GRIPS, last + GRIPS, "s", sd=0.25 * last),
        ],
        [{**s.carried, "carried_load": k * s.carried.get("carried_load", e)} for k in (1.0, 0.5)],
        description="a load that is carried for a part of the log",
    )
