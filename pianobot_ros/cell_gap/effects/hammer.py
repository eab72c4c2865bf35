"""A hammer rides on the key: a mass behind a unilateral coupler that flies free (Gillespie's hybrid action, two bodies)."""

from __future__ import annotations

from pianobot_ros.cell_gap.effects.base import Values, family
from pianobot_ros.gap import Parameter


def _mechanics(v: Values) -> dict[str, float]:
    return {"hammer": v["hammer"], "hammer_coupling": v["hammer_coupling"]}


FAMILY = family(
    "hammer", "key", "a hammer's mass rides on the key and may fly free",
    [Parameter("hammer", 0.0, 0.0, 0.5, "kg", sd=0.03),
     Parameter("hammer_coupling", 1892.1, 100.0, 20000.0, "N/m", sd=0.7, log=True)],
    [{"hammer": x} for x in (0.003, 0.015, 0.06)], mechanics=_mechanics,
)  # fmt: skip
