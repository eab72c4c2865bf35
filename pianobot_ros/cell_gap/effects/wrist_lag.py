"""The wrist follows sluggishly: an additional first-order lag, so that fast motion is damped and slow motion is only late."""

from __future__ import annotations

import numpy as np

from pianobot_ros.cell_gap.effects.base import Array, Values, family
from pianobot_ros.cell_gap.effects.filters import lag
from pianobot_ros.gap import Parameter


def _wrist(v: Values, t: Array, z: Array, force: Array) -> Array:
    del force
    return z if v["wrist_lag"] <= 0 else np.asarray(lag(t, z, v["wrist_lag"]))


FAMILY = family(
    "wrist_lag", "wrist", "the wrist follows its command through an additional lag",
    [Parameter("wrist_lag", 0.0, 0.0, 0.15, "s", sd=0.02)],
    [{"wrist_lag": x} for x in (0.003, 0.015, 0.05)], wrist=_wrist,
)  # fmt: skip
