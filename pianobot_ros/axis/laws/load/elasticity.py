"""Elastic joint: part of the inertia hangs on a spring (harmonic drive, belt, coupling) and rings
after the motor moved.
"""

from __future__ import annotations

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter


def effect(s: Scales) -> Effect:
    """Period of the load on its spring with the motor held (s; null 0), share of inertia behind the
    spring, damping, encoder (0 motor, 1 output).
    """
    return Effect(
        "elasticity",
        "transmission",
        [
            Parameter("elastic_period", 0.0, 0.0, 1.0, "s", sd=0.1),
            Parameter("elastic_share", 0.5, 0.05, 0.95, "1", sd=0.2),
            Parameter("elastic_damping", 0.05, 0.005, 0.7, "1", sd=0.7, log=True),
            Parameter("elastic_output", 0.0, 0.0, 1.0, "1", sd=0.5),
        ],
        [
            {
                "elastic_period": 0.03 * 1.5**k,
                "elastic_share": 0.5,
                "elastic_damping": 0.05,
                "elastic_output": output,
            }
            for output in (0.0, 1.0)
            for k in range(8)
        ],
        description="the load hangs on a spring",
    )
