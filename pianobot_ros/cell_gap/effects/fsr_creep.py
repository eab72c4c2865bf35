"""The force sensor's reading creeps under constant load, alike in every decade of time: Kelvin branches a decade apart.

Data sheets of force-sensing resistors give the drift per decade (FSR 400: less than 5 % per log10 of the time).
"""

from __future__ import annotations

import numpy as np

from pianobot_ros.cell_gap.effects.base import Array, Values, family
from pianobot_ros.cell_gap.effects.filters import creep, uncreep
from pianobot_ros.gap import Parameter

BRANCHES = 3


def _read(v: Values, t: Array, f: Array) -> Array:
    return np.asarray(creep(t, f, v["fsr_creep"], v["fsr_creep_time"], BRANCHES))


def _unread(v: Values, t: Array, y: Array) -> Array:
    return np.asarray(uncreep(t, y, v["fsr_creep"], v["fsr_creep_time"], BRANCHES))


FAMILY = family(
    "fsr_creep", "sensing", "the force sensor's reading creeps under load",
    [Parameter("fsr_creep", 0.0, -0.3, 1.0, "1", sd=0.05),
     Parameter("fsr_creep_time", 0.02, 0.002, 1.0, "s", sd=0.8, log=True)],
    [{"fsr_creep": 0.02}, {"fsr_creep": 0.1}, {"fsr_creep": 0.05, "fsr_creep_time": 0.006},
     {"fsr_creep": 0.1, "fsr_creep_time": 0.1}],
    read=_read, unread=_unread,
)  # fmt: skip
