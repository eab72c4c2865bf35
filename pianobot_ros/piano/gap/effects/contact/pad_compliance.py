"""The fingertip's pad is softer than it should be: another stiffness, and a soft start as of a
rounded or rough surface.

The force at compression x is s k x² / (x + d) (Greenwood and Tripp 1967, linearised for large x).
"""

from __future__ import annotations

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import StrikeLaw, Values


def _mechanics(v: Values) -> dict[str, float]:
    return {"pad_stiffness": 1.0 / (1.0 + v["pad_compliance"]), "pad_softening": v["pad_softening"]}


EFFECT = Effect(
    "pad_compliance",
    "contact",
    [
        Parameter("pad_compliance", 0.0, -0.7, 20.0, "1", sd=0.8),
        Parameter("pad_softening", 0.0, 0.0, 3e-3, "m", sd=5e-4),
    ],
    [
        {"pad_compliance": 0.3},
        {"pad_compliance": 2.0},
        {"pad_compliance": 0.1, "pad_softening": 5e-4},
    ],
    description="the fingertip's pad is softer, most of all at first touch",
    law=StrikeLaw(_mechanics),
)
