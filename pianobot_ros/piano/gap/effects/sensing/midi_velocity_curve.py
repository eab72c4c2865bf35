"""The keyboard's velocity curve is no line: a power bent into an S, fixed at 127 (the touch curves
of digital pianos).

Magnitude and mix: at an angle of 0 all of it is the power, at ±90° all of it the S.
"""

from __future__ import annotations

import numpy as np

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import Array, Values, VelocityLaw


def _velocity(v: Values, x: Array) -> Array:
    size, mix = v["midi_velocity_curve"], v["midi_velocity_shape"]
    u = np.maximum(x / 127.0, 1e-6) ** (1.0 + size * np.cos(mix))
    inside = np.clip(u, 0.0, 1.0)
    bend = np.clip(
        3.0 * size * np.sin(mix), -1.8, 0.95
    )  # beyond, louder strokes would give softer notes
    return np.asarray(127.0 * (u + bend * inside * (1.0 - inside) * (2.0 * inside - 1.0)))


# an S of either sign, and one that rises early, as a logistic curve does
SHAPES = ((0.2, 1.2), (-0.2, 1.2), (-0.2, -0.6))

EFFECT = Effect(
    "midi_velocity_curve",
    "sensing",
    [
        Parameter("midi_velocity_curve", 0.0, -0.8, 3.0, "1", sd=0.3),
        Parameter("midi_velocity_shape", 0.0, -1.57, 1.57, "rad", sd=0.5),
    ],
    [{"midi_velocity_curve": x} for x in (0.1, -0.1, 0.5, -0.4)]
    + [{"midi_velocity_curve": x, "midi_velocity_shape": s} for x, s in SHAPES],
    description="MIDI velocity is not proportional to key speed",
    law=VelocityLaw(_velocity),
)
