"""The force sensor's reading creeps up under constant load: a share that follows with one time constant."""

from __future__ import annotations

import numpy as np

from pianobot_ros.cell_gap.effects.base import Array, Values, family
from pianobot_ros.cell_gap.effects.filters import lag, leaky_force
from pianobot_ros.gap import Parameter


def _read(v: Values, t: Array, f: Array) -> Array:
    return np.asarray(f + v["fsr_creep"] * lag(t, f, v["fsr_creep_time"]))


def _unread(v: Values, t: Array, y: Array) -> Array:
    return np.asarray(leaky_force(t, y, v["fsr_creep"], v["fsr_creep_time"]))


FAMILY = family(
    "fsr_creep", "sensing", "the force sensor's reading creeps under load",
    [Parameter("fsr_creep", 0.0, -0.5, 2.0, "1", sd=0.15),
     Parameter("fsr_creep_time", 0.2, 0.02, 5.0, "s", sd=0.8, log=True)],
    [{"fsr_creep": 0.05}, {"fsr_creep": 0.3}, {"fsr_creep": 0.15, "fsr_creep_time": 0.06},
     {"fsr_creep": 0.3, "fsr_creep_time": 1.0}],
    read=_read, unread=_unread,
)  # fmt: skip
