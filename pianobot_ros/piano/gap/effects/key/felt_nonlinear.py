"""The felt under the key is no linear spring: a power law (Hunt and Crossley 1975), and it may be
met earlier.
"""

from __future__ import annotations

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import StrikeLaw, Values


def _mechanics(v: Values) -> dict[str, float]:
    return {"felt_exponent": 1.0 + v["felt_nonlinear"], "felt_thickness": v["felt_thickness"]}


EFFECT = Effect(
    "felt_nonlinear",
    "key",
    [
        Parameter("felt_nonlinear", 0.0, -0.4, 4.0, "1", sd=0.6),
        Parameter("felt_thickness", 0.0, -1e-3, 4e-3, "m", sd=5e-4),
    ],
    [
        {"felt_nonlinear": 0.2},
        {"felt_nonlinear": 1.0},
        {"felt_nonlinear": 1.0, "felt_thickness": 5e-4},
        {"felt_nonlinear": 0.1, "felt_thickness": 2e-4},
    ],
    description="the key's felt hardens under compression",
    law=StrikeLaw(_mechanics),
)
