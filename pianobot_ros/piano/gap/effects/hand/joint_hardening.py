"""Joint stiffness grows with deflection: k x (1 + b x²), Duffing's law (jammed grains lock as they
are compressed).
"""

from __future__ import annotations

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import StrikeLaw

EFFECT = Effect.of_size(
    Parameter("joint_hardening", 0.0, -30.0, 2000.0, "1/rad^2", "hand", sd=60.0),
    (10.0, 60.0, 300.0),
    "joint stiffness grows with deflection",
    further=[Parameter("joint_hardening_power", 2.0, 0.5, 8.0, "1", sd=0.3, log=True)],
    law=StrikeLaw(),
)
