"""Load-dependent friction: a gear's resistance grows with the torque it transmits."""

from __future__ import annotations

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter


def effect(s: Scales) -> Effect:
    """Share of the transmitted torque lost against the direction of motion, a constant part, and
    how many times larger the share is while the load drives the joint.
    """
    e = s.effort
    return Effect(
        "load_friction",
        "mechanics",
        [
            Parameter("load_friction", 0.0, 0.0, 0.6, "1", sd=0.15),
            Parameter("load_friction_level", 0.0, 0.0, 5 * e, s.effort_unit, sd=0.2 * e),
            Parameter("load_friction_driven", 1.0, 0.2, 4.0, "1", sd=0.3, log=True),
        ],
        [
            {
                "load_friction": share,
                "load_friction_level": level * e,
                "load_friction_driven": driven,
            }
            for share, level, driven in (
                (0.05, 0.02, 1.0),
                (0.2, 0.05, 1.0),
                (0.2, 0.3, 1.0),
                (0.2, 0.05, 2.0),
            )
        ],
        description="friction that grows with the load",
        remainder=("coulomb", {"coulomb": "load_friction_level"}),
    )
