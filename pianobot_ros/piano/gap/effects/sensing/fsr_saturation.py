"""The force sensor flattens at high force: f (1 + k f^p)^(-1/p), with a knee of sharpness p; the
magnitude is the loss at 5 N.
"""

from __future__ import annotations

import numpy as np

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import Array, ForceLaw, Memory, Values

AT = 5.0  # N: where the loss is given


def _bend(v: Values) -> tuple[float, float]:
    """Exponent p and factor k of reading = f (1 + k f^p)^(-1/p)."""
    p = v["fsr_saturation_knee"]
    return p, float(((1.0 - v["fsr_saturation"]) ** -p - 1.0) / AT**p)


def _read(v: Values, t: Array, f: Array, memory: Memory | None = None) -> Array:
    del t, memory
    p, k = _bend(v)
    return np.asarray(f * (1.0 + k * np.maximum(f, 0.0) ** p) ** (-1.0 / p))


def _unread(v: Values, t: Array, y: Array, memory: Memory | None = None) -> Array:
    del t, memory
    p, k = _bend(v)
    return np.asarray(y * (1.0 - np.minimum(k * np.maximum(y, 0.0) ** p, 0.9)) ** (-1.0 / p))


EFFECT = Effect(
    "fsr_saturation",
    "sensing",
    [
        Parameter("fsr_saturation", 0.0, 0.0, 0.8, "1", sd=0.05),
        Parameter("fsr_saturation_knee", 2.5, 1.0, 12.0, "1", sd=0.5, log=True),
    ],
    [
        {"fsr_saturation": x, "fsr_saturation_knee": p}
        for x in (0.005, 0.03, 0.15)
        for p in (2.5, 6.0)
    ],
    description="the force sensor flattens at high force",
    law=ForceLaw(_read, _unread),
)
