"""The keyboard's velocity curve is not linear: velocity to a power, fixed at 127 (the touch curves of digital pianos)."""

from __future__ import annotations

import numpy as np

from pianobot_ros.cell_gap.effects.base import Array, Values, family
from pianobot_ros.gap import Parameter


def _velocity(v: Values, x: Array) -> Array:
    return np.asarray(127.0 * np.maximum(x / 127.0, 1e-6) ** (1.0 + v["midi_velocity_curve"]))


FAMILY = family(
    "midi_velocity_curve", "sensing", "MIDI velocity is not proportional to key speed",
    [Parameter("midi_velocity_curve", 0.0, -0.8, 3.0, "1", sd=0.3)],
    [{"midi_velocity_curve": x} for x in (0.1, -0.1, 0.5, -0.4)], velocity=_velocity,
)  # fmt: skip
