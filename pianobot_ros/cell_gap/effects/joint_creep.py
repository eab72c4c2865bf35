"""The joints creep under load: the standard linear solid, a share of the stiffness relaxes with one time constant."""

from __future__ import annotations

from pianobot_ros.cell_gap.effects.base import Values, family
from pianobot_ros.gap import Parameter


def _mechanics(v: Values) -> dict[str, float]:
    return {"joint_creep": v["joint_creep"], "joint_creep_time": v["joint_creep_time"]}


FAMILY = family(
    "joint_creep", "hand", "joint stiffness relaxes while the finger is loaded",
    [Parameter("joint_creep", 0.0, 0.0, 0.9, "1", sd=0.15),
     Parameter("joint_creep_time", 0.3, 0.02, 5.0, "s", sd=0.8, log=True)],
    [{"joint_creep": 0.05}, {"joint_creep": 0.3}, {"joint_creep": 0.3, "joint_creep_time": 0.08},
     {"joint_creep": 0.4, "joint_creep_time": 1.5}],
    mechanics=_mechanics,
)  # fmt: skip
