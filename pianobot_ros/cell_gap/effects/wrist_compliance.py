"""The contact force pushes the wrist back: a compliance of the arm in series with its servo (Siciliano et al., *Robotics*, 9.2).

The deflection follows the force through a short lag, as a servo's does.
"""

from __future__ import annotations

import numpy as np

from pianobot_ros.cell_gap.effects.base import Array, Values, family
from pianobot_ros.cell_gap.effects.filters import lag
from pianobot_ros.gap import Parameter


def _wrist(v: Values, t: Array, z: Array, force: Array) -> Array:
    return np.asarray(z + v["wrist_compliance"] * lag(t, force, v["wrist_compliance_time"]))


FAMILY = family(
    "wrist_compliance", "wrist", "the contact force deflects the wrist",
    [Parameter("wrist_compliance", 0.0, 0.0, 5e-3, "m/N", sd=2e-4),
     Parameter("wrist_compliance_time", 0.01, 0.001, 0.2, "s", sd=1.0, log=True)],
    [{"wrist_compliance": x} for x in (2e-5, 2e-4, 1e-3)], wrist=_wrist,
)  # fmt: skip
