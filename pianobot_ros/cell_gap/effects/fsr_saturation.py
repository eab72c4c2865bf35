"""The force sensor flattens at high force: f (1 + (f/F)^p)^(-1/p), with a knee of sharpness p; parameter is 1/F, so 0 is none."""

from __future__ import annotations

import numpy as np

from pianobot_ros.cell_gap.effects.base import Array, Values, family
from pianobot_ros.gap import Parameter


def _read(v: Values, t: Array, f: Array) -> Array:
    del t
    p = v["fsr_saturation_knee"]
    u = np.maximum(f, 0.0) * v["fsr_saturation"]
    return np.asarray(f * (1.0 + u**p) ** (-1.0 / p))


def _unread(v: Values, t: Array, y: Array) -> Array:
    del t
    p = v["fsr_saturation_knee"]
    u = np.clip(y * v["fsr_saturation"], 0.0, 0.98)
    return np.asarray(y * (1.0 - u**p) ** (-1.0 / p))


FAMILY = family(
    "fsr_saturation", "sensing", "the force sensor flattens at high force",
    [Parameter("fsr_saturation", 0.0, 0.0, 2.0, "1/N", sd=0.1),
     Parameter("fsr_saturation_knee", 2.5, 1.0, 12.0, "1", sd=0.5, log=True)],
    [{"fsr_saturation": 0.06}, {"fsr_saturation": 0.2}, {"fsr_saturation": 0.25, "fsr_saturation_knee": 6.0},
     {"fsr_saturation": 0.5, "fsr_saturation_knee": 6.0}],
    read=_read, unread=_unread,
)  # fmt: skip
