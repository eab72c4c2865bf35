"""Dry friction of the key: balance pin, guides and bushings (Dahl's model of Coulomb friction)."""

from __future__ import annotations

from pianobot_ros.cell_gap.effects.base import Values, family
from pianobot_ros.gap import Parameter


def _mechanics(v: Values) -> dict[str, float]:
    return {"key_friction": v["key_friction"]}


FAMILY = family(
    "key_friction", "key", "dry friction of the key",
    [Parameter("key_friction", 0.0, 0.0, 0.3, "N*m", sd=0.02)],
    [{"key_friction": x} for x in (0.004, 0.02, 0.06)], mechanics=_mechanics,
)  # fmt: skip
