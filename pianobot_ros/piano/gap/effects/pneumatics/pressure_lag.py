"""The pressure in the finger follows its setpoint slowly: a volume behind a restriction, one time
constant each way, a valve that is wide open far from the setpoint, and less to draw off the less
air is left (isothermal emptying: p' in proportion to p).
"""

from __future__ import annotations

import numpy as np

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import Array, Memory, PressureLaw, Values, recall
from pianobot_ros.piano.gap.effects.filters import air_lag


def _pressure(v: Values, t: Array, p: Array, memory: Memory | None = None) -> Array:
    if v["pressure_lag"] <= 0:
        return p
    return np.asarray(
        air_lag(
            t,
            p,
            v["pressure_lag"],
            v["pressure_lag"] * v["pressure_lag_venting"],
            v["pressure_lag_band"],
            v["pressure_lag_emptying"],
            recall(memory),
        )
    )


EFFECT = Effect(
    "pressure_lag",
    "pneumatics",
    [
        Parameter("pressure_lag", 0.0, 0.0, 5.0, "s", sd=0.3),
        Parameter("pressure_lag_venting", 1.0, 0.2, 5.0, "1", sd=0.5, log=True),
        Parameter("pressure_lag_band", 1e6, 1e3, 1e7, "Pa", sd=2.0, log=True),
        Parameter("pressure_lag_emptying", 0.0, 0.0, 1.2, "1", sd=0.5),
    ],
    [
        {"pressure_lag": 0.03},
        {"pressure_lag": 0.15},
        {"pressure_lag": 0.6},
        {"pressure_lag": 0.01, "pressure_lag_band": 1e4},
        {"pressure_lag": 0.005, "pressure_lag_band": 1e4, "pressure_lag_emptying": 1.0},
    ],
    description="the pressure follows its setpoint slowly",
    law=PressureLaw(_pressure),
)
