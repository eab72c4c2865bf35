"""Air leaks into the finger: vacuum is lost in proportion to its depth, against a regulator of
finite gain.

Two places for a leak: the regulator feels it (a static deficit, first parameter) or supplies in
steps of its own cycle and lets the vacuum decay in between (second parameter, 1/s, since the last
change of setpoint).
"""

from __future__ import annotations

import numpy as np

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import Array, Memory, PressureLaw, Values, recall
from pianobot_ros.piano.gap.effects.filters import since_change

CHANGE = 50.0  # Pa: more is another setpoint


def _pressure(v: Values, t: Array, p: Array, memory: Memory | None = None) -> Array:
    since = since_change(t, p, CHANGE, recall(memory))
    rate = max(v["pressure_leak_rate"], 0.0)
    return np.asarray(
        p * (1.0 - v["pressure_leak"] * (1.0 - np.exp(-rate * since) if rate > 0 else 1.0))
    )


EFFECT = Effect(
    "pressure_leak",
    "pneumatics",
    [
        Parameter("pressure_leak", 0.0, 0.0, 0.9, "1", sd=0.1),
        Parameter("pressure_leak_rate", 1.0, 0.02, 100.0, "1/s", sd=1.5, log=True),
    ],
    [
        {"pressure_leak": 0.05, "pressure_leak_rate": 50.0},
        {"pressure_leak": 0.05, "pressure_leak_rate": 1.0},
        {"pressure_leak": 0.3, "pressure_leak_rate": 0.1},
    ],
    description="vacuum is lost through a leak",
    law=PressureLaw(_pressure),
)
