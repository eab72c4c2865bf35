"""The pressure in the finger follows its setpoint slowly: a volume behind a restriction, one time constant each way."""

from __future__ import annotations

import numpy as np

from pianobot_ros.cell_gap.effects.base import Array, Values, family
from pianobot_ros.cell_gap.effects.filters import rate_lag
from pianobot_ros.gap import Parameter


def _pressure(v: Values, t: Array, p: Array) -> Array:
    if v["pressure_lag"] <= 0:
        return p
    return np.asarray(rate_lag(t, p, v["pressure_lag"], v["pressure_lag"] * v["pressure_lag_venting"]))


FAMILY = family(
    "pressure_lag", "pneumatics", "the pressure follows its setpoint slowly",
    [Parameter("pressure_lag", 0.0, 0.0, 5.0, "s", sd=0.3),
     Parameter("pressure_lag_venting", 1.0, 0.2, 5.0, "1", sd=0.5, log=True)],
    [{"pressure_lag": x} for x in (0.03, 0.15, 0.6)], pressure=_pressure,
)  # fmt: skip
