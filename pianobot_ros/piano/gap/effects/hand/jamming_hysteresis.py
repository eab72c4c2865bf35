"""The jammed grains slip: part of the joint's stiffness is carried by contacts that yield (Iwan
1966, with Dahl's curve).

Unlike joint friction it grows with vacuum, because it is a share of the stiffness. Grains also jam
tighter on the way to more vacuum than they stay on the way back (the hysteresis of jamming itself),
and what has yielded does not come back whole: both show between strikes and not within one, and
both are in proportion to the share that yields.
"""

from __future__ import annotations

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import StrikeLaw, Values


def _mechanics(v: Values) -> dict[str, float]:
    own = {name: v[name] for name in ("jamming_hysteresis", "jamming_yield")}
    return own | {"tip_drop": v["jamming_hysteresis"] * v["jamming_set"]}


def _side(v: Values) -> float:
    return v["jamming_hysteresis"] * v["jamming_side"]


EFFECT = Effect(
    "jamming_hysteresis",
    "hand",
    [
        Parameter("jamming_hysteresis", 0.0, 0.0, 0.95, "1", sd=0.2),
        Parameter("jamming_yield", 0.03, 0.003, 0.3, "rad", sd=0.7, log=True),
        Parameter("jamming_side", 0.0, -3.0, 3.0, "1", sd=0.5),
        Parameter("jamming_set", 0.0, -0.02, 0.02, "m", sd=2e-3),
    ],
    [
        {"jamming_hysteresis": 0.1},
        {"jamming_hysteresis": 0.4},
        {"jamming_hysteresis": 0.4, "jamming_yield": 0.01},
        {"jamming_hysteresis": 0.05, "jamming_side": 0.5},
    ],
    description="part of the jammed joint's stiffness yields and leaves hysteresis",
    law=StrikeLaw(_mechanics, side=_side, states=frozenset({"jamming_set"})),
)
