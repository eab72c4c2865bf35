"""The force sensor reads more while it is unloaded than while it is loaded (data sheets of FSRs: 5
to 10 %).

The loop is in proportion to the force, to a constant, or to both. So it closes at no force, as a
direction-dependent gain does, or leaves a reading there until the next load, as play does and the
Preisach operators that are fitted to force-sensing resistors (Paredes-Madrid et al. 2018, DYNA
85(205), 191-198). The reading changes over from one branch to the other exponentially (Dahl 1968)
while the force, and what it is counted from, changes by a share of itself: what a sum of play
operators with spread thresholds does too (Prandtl-Ishlinskii; Kuhnen 2003).
"""

from __future__ import annotations

import numpy as np

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import Array, ForceLaw, Memory, Values, recall
from pianobot_ros.piano.gap.effects.filters import NOTHING, unloading, unloading_force

NOISES = 4.0
"""Standard deviations of the sensor's noise that turn nothing round."""
LARGE = 10.0
"""N up to which a reading must rise with its force (the range of an FSR 400)."""
RISING = 0.95


def _numbers(v: Values) -> tuple[float, float, float, float]:
    """Gain, share, from and left; the share no less than a reading needs that rises with its
    force.
    """
    gain, share, least, left = (v[f"fsr_hysteresis{n}"] for n in ("", "_scale", "_from", "_left"))
    steepest = max(left / max(least, 0.1), (LARGE + left) / (LARGE + least))
    return gain, max(share, gain * steepest / RISING), least, left


def _read(v: Values, t: Array, f: Array, memory: Memory | None = None) -> Array:
    del t
    gain, share, least, left = _numbers(v)
    return np.asarray(f + gain * unloading(f, share, least, recall(memory)) * (f + left))


def _unread(v: Values, t: Array, y: Array, memory: Memory | None = None) -> Array:
    del t
    return np.asarray(unloading_force(y, *_numbers(v), NOISES * _noise(y), recall(memory)))


def _noise(y: Array) -> float:
    """Standard deviation, N, of a reading's own noise, where nothing else moves it."""
    steps = np.abs(np.diff(y))
    still = steps[steps < NOTHING]
    return float(1.4826 * np.median(still) / np.sqrt(2.0)) if still.size > 10 else 0.0


EFFECT = Effect(
    "fsr_hysteresis",
    "sensing",
    [
        Parameter("fsr_hysteresis", 0.0, -0.5, 1.5, "1", sd=0.15),
        Parameter("fsr_hysteresis_scale", 0.3, 0.05, 3.0, "1", sd=0.7, log=True),
        Parameter("fsr_hysteresis_from", 0.0, 0.0, 40.0, "N", sd=8.0),
        Parameter("fsr_hysteresis_left", 0.0, 0.0, 40.0, "N", sd=8.0),
    ],
    [{"fsr_hysteresis": x} for x in (0.05, -0.05, 0.25)]
    + [{"fsr_hysteresis": 0.05, "fsr_hysteresis_from": 8.0, "fsr_hysteresis_left": 8.0}],
    description="the force sensor reads differently when unloaded",
    law=ForceLaw(_read, _unread, lasting=True),
)
