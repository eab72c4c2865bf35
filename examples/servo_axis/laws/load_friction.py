"""Load-dependent friction: a gear's resistance grows with the torque it transmits."""

from __future__ import annotations

from examples.servo_axis.laws.base import Scales, effect
from pianobot_ros.gap import Effect, Parameter


def build(s: Scales) -> Effect:
    """Share of the transmitted torque lost against the direction of motion, and a constant part."""
    e = s.effort
    return effect("load_friction", "mechanics",
                  [Parameter("load_friction", 0.0, 0.0, 1.0, "1", "mechanics", sd=0.2),
                   Parameter("load_friction_level", 0.0, 0.0, 5 * e, s.effort_unit, "mechanics", sd=0.2 * e)],
                  [[0.05, 0.02 * e], [0.2, 0.05 * e], [0.2, 0.3 * e]], "friction that grows with the load")  # fmt: skip
