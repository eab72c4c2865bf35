"""A payload that the reference did not carry: more gravity and more inertia at once. Offered when a
reference is given.
"""

from __future__ import annotations

from pianobot_ros.axis.laws.base import Scales, effect
from pianobot_ros.gap import Effect, Parameter


def build(s: Scales, carries: bool = False) -> Effect:
    """Added gravity (effort at the horizontal), the angle at which it hangs straight, added
    inertia.

    Where other joints turn the joint's gravity the angle is the sum with theirs; where the joint
    also `carries` them there is a second part, of its own angle alone (`payload_own`).
    """
    e = s.effort
    mass = f"{s.effort_unit}·s²/{s.unit}"
    inertia = Parameter("payload_inertia", 0.0, 0.0, 50 * s.inertia, mass, "load", sd=s.inertia)
    if s.unit == "m":
        weight = Parameter("payload_weight", 0.0, -20 * e, 20 * e, s.effort_unit, "load", sd=e)
        starts = [[f * s.inertia, w * e] for f in (0.3, 1.0) for w in (0.0, 0.5, -0.5)]
        return effect("payload", "load", [inertia, weight], starts, "an added mass")
    own = [
        Parameter(f"payload_{n}", 0.0, 0.0, 20 * e, s.effort_unit, "load", sd=e)
        for n in (("gravity", "own") if carries else ("gravity",))
    ]
    hang = [
        Parameter(f"payload_{n}", 0.0, -4.0, 4.0, "rad", "load", sd=2.0)
        for n in (("angle", "own_angle") if carries else ("angle",))
    ]
    turned = [p for pair in zip(own, hang, strict=True) for p in pair]
    return effect(
        "payload",
        "load",
        [*turned, inertia],
        [
            [*([size * e, a] * len(own)), share * s.inertia]
            for a in (-3.1, -2.36, -1.57, -0.79, 0.0, 0.79, 1.57, 2.36)
            for size, share in ((0.5, 0.1), (2.0, 1.0))
        ],
        "an added mass: gravity and inertia",
    )
