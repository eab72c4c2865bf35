"""The contact force pushes the wrist back: a compliance of the arm in series with its servo
(Siciliano et al., *Robotics*, 9.2).

The deflection follows the force through a short lag, as a servo's does.
"""

from __future__ import annotations

import numpy as np

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import Array, Memory, Values, WristLaw, recall
from pianobot_ros.piano.gap.effects.filters import lag


def _wrist(v: Values, t: Array, z: Array, force: Array, memory: Memory | None = None) -> Array:
    return np.asarray(
        z + v["wrist_compliance"] * lag(t, force, v["wrist_compliance_time"], recall(memory))
    )


def _feels(v: Values) -> float:
    """A force held for that long leaves 1 to 2 % of the deflection out, up to 1 mm/N; a softer arm
    gives way further before it is felt.
    """
    return min(
        4e-3, 0.4 * v["wrist_compliance_time"] * min(1.0, 1e-3 / max(v["wrist_compliance"], 1e-9))
    )


EFFECT = Effect.of_size(
    Parameter("wrist_compliance", 0.0, 0.0, 5e-3, "m/N", "wrist", sd=2e-4),
    (2e-5, 2e-4, 1e-3),
    "the contact force deflects the wrist",
    further=[Parameter("wrist_compliance_time", 0.01, 0.001, 0.2, "s", sd=1.0, log=True)],
    law=WristLaw(_wrist, feels=_feels),
)
