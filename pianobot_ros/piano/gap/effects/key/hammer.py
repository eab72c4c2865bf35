"""A hammer rides on the key: a mass behind a unilateral coupler that flies free (Gillespie's hybrid
action, two bodies).
"""

from __future__ import annotations

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import StrikeLaw

EFFECT = Effect(
    "hammer",
    "key",
    [
        Parameter("hammer", 0.0, 0.0, 0.5, "kg", sd=0.03),
        Parameter("hammer_coupling", 1892.1, 100.0, 20000.0, "N/m", sd=0.7, log=True),
        # weight over mass at the key: g over the mechanical advantage, less with springs or
        # counterweights, more with a lever's arc
        Parameter("hammer_weight", 1.96, 0.0, 20.0, "m/s^2", sd=2.0),
        # angle at which the jack leaves the hammer; beyond the key's travel it never does, as in
        # many digital pianos
        Parameter("hammer_escape", 0.06, 0.02, 0.07, "rad", sd=0.02),
        Parameter("hammer_damping", 5.33, 0.2, 50.0, "N*s/m", sd=0.7, log=True),
        # share of the coupling that pulls too: 0 for a hammer that flies, 1 for one that is linked
        # to its key, as the weights of many digital pianos are
        Parameter("hammer_captive", 0.0, 0.0, 1.0, "1", sd=0.4),
    ],
    [{"hammer": x} for x in (0.003, 0.015, 0.06)]
    + [{"hammer": 0.015, "hammer_escape": 0.038}]
    + [{"hammer": 0.015, "hammer_captive": 1.0, "hammer_coupling": 600.0, "hammer_weight": 0.0}],
    description="a hammer's mass rides on the key and may fly free",
    law=StrikeLaw(),
)
