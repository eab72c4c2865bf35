"""A payload that the reference did not carry: more gravity and more inertia at once. Offered when a
reference is given.
"""

from __future__ import annotations

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter


def effect(s: Scales, carries: bool = False) -> Effect:
    """Added gravity (effort at the horizontal), the angle at which it hangs straight, added
    inertia.

    Where other joints turn the joint's gravity the angle is the sum with theirs; where the joint
    also `carries` them there is a second part, of its own angle alone (`payload_own`).
    """
    e = s.effort
    mass = f"{s.effort_unit}·s²/{s.unit}"
    inertia = Parameter("payload_inertia", 0.0, 0.0, 50 * s.inertia, mass, sd=s.inertia)
    if s.unit == "m":
        weight = Parameter("payload_weight", 0.0, -20 * e, 20 * e, s.effort_unit, sd=e)
        return Effect(
            "payload",
            "load",
            [inertia, weight],
            [
                {"payload_inertia": share * s.inertia, "payload_weight": size * e}
                for share in (0.3, 1.0)
                for size in (0.0, 0.5, -0.5)
            ],
            description="an added mass",
        )
    turned = {"payload_gravity": "payload_angle"}
    if carries:
        turned["payload_own"] = "payload_own_angle"
    parameters = []
    for size, angle in turned.items():
        parameters.append(Parameter(size, 0.0, 0.0, 20 * e, s.effort_unit, sd=e))
        parameters.append(Parameter(angle, 0.0, -4.0, 4.0, "rad", sd=2.0))
    return Effect(
        "payload",
        "load",
        [*parameters, inertia],
        [
            {n: x for g, q in turned.items() for n, x in ((g, size * e), (q, a))}
            | {"payload_inertia": share * s.inertia}
            for a in (-3.1, -2.36, -1.57, -0.79, 0.0, 0.79, 1.57, 2.36)
            for size, share in ((0.5, 0.1), (2.0, 1.0))
        ],
        description="an added mass: gravity and inertia",
    )
