"""The fingertip slips on the key where it should stick: Coulomb friction lower by a share."""

from __future__ import annotations

from pianobot_ros.cell_gap.effects.base import Values, family
from pianobot_ros.gap import Parameter


def _mechanics(v: Values) -> dict[str, float]:
    return {"tip_slip": v["tip_slip"]}


FAMILY = family(
    "tip_slip", "contact", "the fingertip slips along the key",
    [Parameter("tip_slip", 0.0, -1.0, 1.0, "1", sd=0.4)],
    [{"tip_slip": x} for x in (0.15, 0.5, 0.9)], mechanics=_mechanics,
)  # fmt: skip
