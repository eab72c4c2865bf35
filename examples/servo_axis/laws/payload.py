"""A payload that the reference did not carry: more gravity and more inertia at once. Offered when a reference is given."""

from __future__ import annotations

from examples.servo_axis.laws.base import Scales, effect
from pianobot_ros.gap import Effect, Parameter


def build(s: Scales) -> Effect:
    """Added gravity (effort at the horizontal), the angle at which it hangs straight, added inertia."""
    e = s.effort
    return effect("payload", "mechanics",
                  [Parameter("payload_gravity", 0.0, 0.0, 20 * e, s.effort_unit, "mechanics", sd=e),
                   Parameter("payload_angle", 0.0, -4.0, 4.0, "rad", "mechanics", sd=2.0),
                   Parameter("payload_inertia", 0.0, 0.0, 20 * e, f"{s.effort_unit}·s²/rad", "mechanics", sd=e)],
                  [[0.5 * e, a, 0.0] for a in (-3.1, -2.36, -1.57, -0.79, 0.0, 0.79, 1.57, 2.36)],
                  "an added mass: gravity and inertia")  # fmt: skip
