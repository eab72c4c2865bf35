"""Dry friction in the finger's joints, the same torque at any vacuum: Dahl's model of Coulomb
friction (Dahl 1968), more of it near rest (Stribeck), and where it held the joints after the last
strike.
"""

from __future__ import annotations

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import StrikeLaw

EFFECT = Effect(
    "joint_friction",
    "hand",
    [
        Parameter("joint_friction", 0.0, 0.0, 0.5, "N*m", sd=0.03),
        Parameter("joint_friction_static", 0.0, -0.5, 2.0, "1", sd=0.4),
        Parameter("joint_friction_rest", 0.0, -1.0, 1.0, "1", sd=0.5),
        Parameter("joint_friction_breakaway", 0.003, 3e-4, 0.03, "rad", sd=0.7, log=True),
        Parameter("joint_friction_creep", 0.0, 0.0, 100.0, "1/s", sd=5.0),
    ],
    [{"joint_friction": x} for x in (0.005, 0.025, 0.1)]
    + [{"joint_friction": 0.025, "joint_friction_creep": 10.0}],
    description="dry friction in the finger's joints",
    law=StrikeLaw(states=frozenset({"joint_friction_rest"})),
)
