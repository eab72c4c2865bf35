"""The force sensor reads more while it is unloaded than while it is loaded (data sheets of FSRs: 5
to 10 %).

The reading changes over from one branch to the other while the force, and what it is counted from,
changes by a share of itself.
"""

from __future__ import annotations

import numpy as np

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import Array, ForceLaw, Memory, Values, recall
from pianobot_ros.piano.gap.effects.filters import unloading, unloading_force


def _numbers(v: Values) -> tuple[float, float, float]:
    return v["fsr_hysteresis"], v["fsr_hysteresis_scale"], v["fsr_hysteresis_from"]


def _read(v: Values, t: Array, f: Array, memory: Memory | None = None) -> Array:
    del t
    gain, share, least = _numbers(v)
    return np.asarray(f * (1.0 + gain * unloading(f, share, least, recall(memory))))


def _unread(v: Values, t: Array, y: Array) -> Array:
    del t
    return np.asarray(unloading_force(y, *_numbers(v)))


EFFECT = Effect.of_size(
    Parameter("fsr_hysteresis", 0.0, -0.5, 1.5, "1", "sensing", sd=0.15),
    (0.05, -0.05, 0.25),
    "the force sensor reads differently when unloaded",
    further=[
        Parameter("fsr_hysteresis_scale", 0.3, 0.05, 3.0, "1", sd=0.7, log=True),
        Parameter("fsr_hysteresis_from", 0.0, 0.0, 40.0, "N", sd=8.0),
    ],
    law=ForceLaw(_read, _unread),
)
