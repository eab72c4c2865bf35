"""MIDI events arrive late by a time that varies from event to event: all of them, or only a share
that has to wait.

Measured delays of interfaces and drivers are narrow for most events, and some come a poll or a
scheduler's turn later (Schultz 2019, Behavior Research Methods 51, "The Schultz MIDI Benchmarking
Toolbox"). So the law is a mixture: a share of the events waits for a Gaussian time. With the whole
share it is a Gaussian jitter, with a small one the tails are heavy.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import Array, LatencyLaw, Values


def _spread(v: Values, u: Array) -> Array:
    wait = v["midi_jitter"] * (ndtri(u[..., 0]) + v["midi_jitter_wait"])
    return np.asarray(np.where(u[..., 1] < v["midi_jitter_share"], wait, 0.0))


EFFECT = Effect(
    "midi_jitter",
    "sensing",
    [
        Parameter("midi_jitter", 0.0, 0.0, 0.1, "s", sd=0.005),
        Parameter("midi_jitter_delay", 0.0, -0.02, 0.1, "s", sd=0.005),
        Parameter("midi_jitter_share", 1.0, 0.02, 1.0, "1", sd=0.5),
        Parameter("midi_jitter_wait", 0.0, 0.0, 20.0, "1", sd=2.0),
    ],
    [{"midi_jitter": x} for x in (0.002, 0.006, 0.02)]
    + [
        {"midi_jitter": x, "midi_jitter_share": 0.2, "midi_jitter_wait": 2.0}
        for x in (0.002, 0.006)
    ],
    description="the time stamps of MIDI events scatter",
    law=LatencyLaw(delay="midi_jitter_delay", spread=_spread),
)
