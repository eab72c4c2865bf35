"""The regulator sticks: where its pressure settles depends on the side from which its setpoint
came.

A loop around the setpoint, of constant width or in proportion to the vacuum (what friction of a
spool and of a diaphragm do; data sheets state it as hysteresis in % of full scale). It is run
through by play (Krasnosel'skii and Pokrovskii 1989) over the loop's own width, which is a valve
that does not move at all within it, over less, which is an offset by direction, or over more, which
is a share of each step. Of what it is short by it may make up a part later (stick, then creep).
"""

from __future__ import annotations

import numpy as np

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import Array, Memory, PressureLaw, Values
from pianobot_ros.piano.gap.effects.filters import crept_back, play

CHANGE = 50.0  # Pa: more is another setpoint
TYPICAL = 50e3  # Pa: vacuum at which the width is given


def _pressure(v: Values, t: Array, p: Array, memory: Memory | None = None) -> Array:
    size, graded = v["regulator_hysteresis"], v["regulator_hysteresis_graded"]
    if size <= 0.0:
        return p
    memory = memory or Memory()
    path = max(size * v["regulator_hysteresis_path"], 1.0)
    side = 2.0 * (play(p, path, memory.state) - p) / path  # -1 where it came from below, to 1
    width = size * (1.0 - graded + graded * np.abs(p) / TYPICAL)
    back, slow = v["regulator_hysteresis_back"], v["regulator_hysteresis_time"]
    return np.asarray(p + 0.5 * width * side * crept_back(t, p, CHANGE, back, slow, memory.state))


EFFECT = Effect(
    "regulator_hysteresis",
    "pneumatics",
    [
        Parameter("regulator_hysteresis", 0.0, 0.0, 60e3, "Pa", sd=3e3),
        Parameter("regulator_hysteresis_path", 1.0, 0.1, 100.0, "1", sd=1.5, log=True),
        Parameter("regulator_hysteresis_graded", 0.0, 0.0, 1.0, "1", sd=0.5),
        Parameter("regulator_hysteresis_back", 0.0, 0.0, 1.0, "1", sd=0.5),
        Parameter("regulator_hysteresis_time", 1.0, 0.02, 30.0, "s", sd=1.5, log=True),
    ],
    [{"regulator_hysteresis": x} for x in (500.0, 3e3, 12e3)]
    + [
        {"regulator_hysteresis": 1e3, "regulator_hysteresis_path": 30.0},
        {
            "regulator_hysteresis": 1e3,
            "regulator_hysteresis_graded": 1.0,
            "regulator_hysteresis_back": 0.7,
            "regulator_hysteresis_time": 0.5,
        },
    ],
    description="the pressure depends on the direction from which its setpoint was reached",
    law=PressureLaw(_pressure),
)
