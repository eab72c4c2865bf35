"""The keyboard's velocity curve is no line: a power, bent into an S, with a knee and an offset, the
same at 127 (the touch curves of digital pianos; what one speed sends differs much between
instruments: Dannenberg 2006, "The interpretation of MIDI velocity", ICMC).

The magnitude is the power's; the others stand beside it. A small power with an offset is a
logarithm.
"""

from __future__ import annotations

import numpy as np

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import Array, Values, VelocityLaw


def _velocity(v: Values, x: Array) -> Array:
    u = np.maximum(x / 127.0, 1e-6) ** (1.0 + v["midi_velocity_curve"])
    inside = np.clip(u, 0.0, 1.0)
    # beyond these limits, louder strokes would give softer notes
    bend = np.clip(3.0 * v["midi_velocity_shape"], -1.8, 0.95)
    u = u + bend * inside * (1.0 - inside) * (2.0 * inside - 1.0)
    at = v["midi_velocity_knee_at"]
    steeper = np.clip(v["midi_velocity_knee"], -0.95 / at, 0.95 / (1.0 - at))
    u = u + steeper * (np.maximum(u - at, 0.0) - (1.0 - at) * u)
    return np.asarray(127.0 * (u + v["midi_velocity_offset"] * (1.0 - u)))


# an S of either sign, one that rises early, as a logistic curve does, and knees
BENT = (
    {"midi_velocity_curve": 0.1, "midi_velocity_shape": 0.2},
    {"midi_velocity_curve": 0.1, "midi_velocity_shape": -0.2},
    {"midi_velocity_curve": -0.2, "midi_velocity_shape": 0.1},
    {"midi_velocity_curve": 0.05, "midi_velocity_knee": 0.4},
    {"midi_velocity_curve": 0.05, "midi_velocity_knee": -0.4},
)

EFFECT = Effect(
    "midi_velocity_curve",
    "sensing",
    [
        Parameter("midi_velocity_curve", 0.0, -0.8, 3.0, "1", sd=0.3),
        Parameter("midi_velocity_shape", 0.0, -0.6, 0.32, "1", sd=0.15),
        Parameter("midi_velocity_knee", 0.0, -0.9, 0.9, "1", sd=0.3),
        Parameter("midi_velocity_knee_at", 0.5, 0.1, 0.9, "1", sd=0.2),
        Parameter("midi_velocity_offset", 0.0, -0.5, 0.5, "1", sd=0.05),
    ],
    [{"midi_velocity_curve": x} for x in (0.1, -0.1, 0.5, -0.4)] + list(BENT),
    description="MIDI velocity is not proportional to key speed",
    law=VelocityLaw(_velocity),
)
