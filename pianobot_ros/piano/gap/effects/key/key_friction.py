"""Dry friction of the key: balance pin, guides and bushings (Dahl's model of Coulomb friction; more
near rest, Stribeck).
"""

from __future__ import annotations

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import StrikeLaw

EFFECT = Effect.of_size(
    Parameter("key_friction", 0.0, 0.0, 0.3, "N*m", "key", sd=0.02),
    (0.004, 0.02, 0.06),
    "dry friction of the key",
    further=[Parameter("key_friction_static", 0.0, -0.5, 2.0, "1", sd=0.4)],
    law=StrikeLaw(),
)
