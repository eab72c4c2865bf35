"""The jammed grains slip: part of the joint's stiffness is carried by contacts that yield (Iwan 1966, with Dahl's curve).

Unlike joint friction it grows with vacuum, because it is a share of the stiffness.
"""

from __future__ import annotations

from pianobot_ros.cell_gap.effects.base import Values, family
from pianobot_ros.gap import Parameter


def _mechanics(v: Values) -> dict[str, float]:
    return {"jamming_hysteresis": v["jamming_hysteresis"], "jamming_yield": v["jamming_yield"]}


FAMILY = family(
    "jamming_hysteresis", "hand", "part of the jammed joint's stiffness yields and leaves hysteresis",
    [Parameter("jamming_hysteresis", 0.0, 0.0, 0.95, "1", sd=0.2),
     Parameter("jamming_yield", 0.03, 0.003, 0.3, "rad", sd=0.7, log=True)],
    [{"jamming_hysteresis": 0.1}, {"jamming_hysteresis": 0.4}, {"jamming_hysteresis": 0.4, "jamming_yield": 0.01}],
    mechanics=_mechanics,
)  # fmt: skip
