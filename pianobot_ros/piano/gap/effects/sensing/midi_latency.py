"""MIDI events arrive late by a time that is the same for all, note-on and note-off alike (key
scanning, 31250 baud, drivers), or nearly: what is polled waits up to a period more or less.

Up to half of the delay differs from event to event, evenly (USB polls each millisecond or slower:
Schultz 2019, Behavior Research Methods 51). Where more does, it is a jitter.
"""

from __future__ import annotations

import numpy as np

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import Array, LatencyLaw, Values


def _spread(v: Values, u: Array) -> Array:
    return np.asarray(v["midi_latency"] * v["midi_latency_polled"] * (2.0 * u[..., 0] - 1.0))


EFFECT = Effect.of_size(
    Parameter("midi_latency", 0.0, 0.0, 0.2, "s", "sensing", sd=0.01),
    (0.002, 0.01, 0.05),
    "MIDI events arrive late by a fixed time",
    further=[Parameter("midi_latency_polled", 0.0, 0.0, 0.5, "1", sd=0.2)],
    law=LatencyLaw(delay="midi_latency", spread=_spread),
)
