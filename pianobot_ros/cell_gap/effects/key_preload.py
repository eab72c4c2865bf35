"""The key's spring is preloaded against the rest stop: a constant torque before the key moves at all (touch weight)."""

from __future__ import annotations

from pianobot_ros.cell_gap.effects.base import Values, family
from pianobot_ros.gap import Parameter


def _mechanics(v: Values) -> dict[str, float]:
    return {"key_preload": v["key_preload"]}


FAMILY = family(
    "key_preload", "key", "the key needs a constant force before it moves",
    [Parameter("key_preload", 0.0, 0.0, 0.5, "N*m", sd=0.03)],
    [{"key_preload": x} for x in (0.004, 0.02, 0.08)], mechanics=_mechanics,
)  # fmt: skip
