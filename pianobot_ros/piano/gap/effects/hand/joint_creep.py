"""The joints creep under load: a share of the stiffness relaxes, with one time constant (standard
linear solid) or with two, `joint_creep_spread` times quicker and slower.
"""

from __future__ import annotations

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import StrikeLaw

EFFECT = Effect(
    "joint_creep",
    "hand",
    [
        Parameter("joint_creep", 0.0, 0.0, 0.9, "1", sd=0.15),
        Parameter("joint_creep_time", 0.3, 0.02, 5.0, "s", sd=0.8, log=True),
        Parameter("joint_creep_spread", 1.0, 1.0, 30.0, "1", sd=1.0, log=True),
    ],
    [{"joint_creep": x} for x in (0.05, 0.3)]
    + [{"joint_creep": x, "joint_creep_time": t} for x, t in ((0.3, 0.08), (0.4, 1.5))]
    + [{"joint_creep": 0.2, "joint_creep_spread": 6.0}],
    description="joint stiffness relaxes while the finger is loaded",
    law=StrikeLaw(),
)
