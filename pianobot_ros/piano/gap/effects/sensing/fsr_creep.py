"""The force sensor's reading creeps under load: its gain grows with a power of the time since the
load came on.

Data sheets of force-sensing resistors give the drift as a function of that time (FSR 400: less than
5 % per decade).
"""

from __future__ import annotations

import numpy as np

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import Array, ForceLaw, Memory, Values, recall
from pianobot_ros.piano.gap.effects.filters import under_load


def _gain(v: Values, t: Array, f: Array, memory: Memory | None = None) -> Array:
    return np.asarray(
        1.0 + v["fsr_creep"] * under_load(t, f, recall(memory)) ** v["fsr_creep_power"]
    )


def _read(v: Values, t: Array, f: Array, memory: Memory | None = None) -> Array:
    return f * _gain(v, t, f, memory)


def _unread(v: Values, t: Array, y: Array) -> Array:
    return np.asarray(y / np.maximum(_gain(v, t, y), 0.1))


EFFECT = Effect(
    "fsr_creep",
    "sensing",
    [
        Parameter("fsr_creep", 0.0, -0.5, 2.0, "1", sd=0.1),
        Parameter("fsr_creep_power", 0.4, 0.05, 1.0, "1", sd=0.5, log=True),
    ],
    [{"fsr_creep": x} for x in (0.03, 0.1)]
    + [{"fsr_creep": 0.1, "fsr_creep_power": p} for p in (0.2, 0.8)],
    description="the force sensor's reading creeps under load",
    law=ForceLaw(_read, _unread),
)
