"""The force sensor's reading creeps under load: its gain grows with the time since the load came
on, or a part of the load's own past is read with it, lasts after the load is gone and fades.

The growth is ((1 + t/T)^p - 1) / p: a power of time (Nutting 1921; Findley, Lai and Onaran 1976),
the logarithm of data sheets (p = 0; FSR 400: less than 5 % per decade) or one exponential (p below
-2), and as a sum of exponentials it is the linear creep operator that compensators of sensors and
actuators invert (Krejci and Kuhnen 2001; Kuhnen 2003). What lasts is Boltzmann's superposition.
"""

from __future__ import annotations

import numpy as np

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import Array, ForceLaw, Memory, Values, recall
from pianobot_ros.piano.gap.effects.filters import creep, creep_shares


def _crept(v: Values, t: Array, x: Array, undo: bool, memory: Memory | None) -> Array:
    size, lasting = v["fsr_creep"], v["fsr_creep_lasting"]
    tau, power = v["fsr_creep_time"], v["fsr_creep_power"]
    gains = np.array([size * (1.0 - lasting), size * lasting])
    shares = creep_shares(tau, power)
    return np.asarray(creep(t, x, gains, shares, tau, power, undo, recall(memory)))


def _read(v: Values, t: Array, f: Array, memory: Memory | None = None) -> Array:
    return _crept(v, t, f, False, memory)


def _unread(v: Values, t: Array, y: Array, memory: Memory | None = None) -> Array:
    return _crept(v, t, y, True, memory)


EFFECT = Effect(
    "fsr_creep",
    "sensing",
    [
        Parameter("fsr_creep", 0.0, -0.5, 2.0, "1", sd=0.1),
        Parameter("fsr_creep_power", 0.4, -3.0, 0.9, "1", sd=0.7),
        Parameter("fsr_creep_time", 0.01, 1e-4, 10.0, "s", sd=1.5, log=True),
        Parameter("fsr_creep_lasting", 0.0, 0.0, 1.0, "1", sd=0.5),
    ],
    [{"fsr_creep": x} for x in (0.03, 0.1)]
    + [
        {"fsr_creep": 0.1, "fsr_creep_power": 0.8},
        {"fsr_creep": 0.05, "fsr_creep_power": -2.0, "fsr_creep_time": 0.4},
        {"fsr_creep": 0.05, "fsr_creep_lasting": 1.0},
        {
            "fsr_creep": 0.05,
            "fsr_creep_power": -2.0,
            "fsr_creep_time": 0.4,
            "fsr_creep_lasting": 1.0,
        },
    ],
    description="the force sensor's reading creeps under load",
    law=ForceLaw(_read, _unread, lasting=True),
)
