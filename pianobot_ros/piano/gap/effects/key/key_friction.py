"""Dry friction of the key: balance pin, guides and bushings (Dahl's model of Coulomb friction; more
near rest, Stribeck).
"""

from __future__ import annotations

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import StrikeLaw

EFFECT = Effect(
    "key_friction",
    "key",
    [
        Parameter("key_friction", 0.0, 0.0, 0.3, "N*m", sd=0.02),
        Parameter("key_friction_static", 0.0, -0.5, 2.0, "1", sd=0.4),
        Parameter("key_friction_breakaway", 0.0008, 8e-5, 0.008, "rad", sd=0.7, log=True),
        Parameter("key_friction_creep", 0.0, 0.0, 100.0, "1/s", sd=5.0),
    ],
    [{"key_friction": x} for x in (0.004, 0.02, 0.06)]
    + [{"key_friction": 0.02, "key_friction_creep": 10.0}],
    description="dry friction of the key",
    law=StrikeLaw(),
)
