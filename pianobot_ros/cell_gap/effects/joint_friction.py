"""Dry friction in the finger's joints: Dahl's model of Coulomb friction (Dahl 1968), the same torque at any vacuum."""

from __future__ import annotations

from pianobot_ros.cell_gap.effects.base import Values, family
from pianobot_ros.gap import Parameter


def _mechanics(v: Values) -> dict[str, float]:
    return {"joint_friction": v["joint_friction"]}


FAMILY = family(
    "joint_friction", "hand", "dry friction in the finger's joints",
    [Parameter("joint_friction", 0.0, 0.0, 0.5, "N*m", sd=0.03)],
    [{"joint_friction": x} for x in (0.005, 0.025, 0.1)], mechanics=_mechanics,
)  # fmt: skip
