"""The regulator sticks: its pressure lags behind the setpoint by a play, so it depends on where the
setpoint came from.
"""

from __future__ import annotations

import numpy as np

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import Array, Memory, PressureLaw, Values, recall
from pianobot_ros.piano.gap.effects.filters import play


def _pressure(v: Values, t: Array, p: Array, memory: Memory | None = None) -> Array:
    del t
    return np.asarray(play(p, v["regulator_hysteresis"], recall(memory)))


EFFECT = Effect.of_size(
    Parameter("regulator_hysteresis", 0.0, 0.0, 60e3, "Pa", "pneumatics", sd=3e3),
    (500.0, 3e3, 12e3),
    "the pressure depends on the direction from which its setpoint was reached",
    law=PressureLaw(_pressure),
)
