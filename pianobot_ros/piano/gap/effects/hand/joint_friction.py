"""Dry friction in the finger's joints, the same torque at any vacuum: Dahl's model of Coulomb
friction (Dahl 1968), more of it near rest (Stribeck), and where it held the joints after the last
strike.
"""

from __future__ import annotations

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import StrikeLaw

EFFECT = Effect.of_size(
    Parameter("joint_friction", 0.0, 0.0, 0.5, "N*m", "hand", sd=0.03),
    (0.005, 0.025, 0.1),
    "dry friction in the finger's joints",
    further=[
        Parameter("joint_friction_static", 0.0, -0.5, 2.0, "1", sd=0.4),
        Parameter("joint_friction_rest", 0.0, -1.0, 1.0, "1", sd=0.5),
    ],
    law=StrikeLaw(states=frozenset({"joint_friction_rest"})),
)
