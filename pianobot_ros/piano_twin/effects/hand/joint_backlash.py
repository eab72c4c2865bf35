"""Play in the finger's joints: a dead zone of the joint spring (Nordin and Gutman 2002)."""

from __future__ import annotations

from pianobot_ros.gap import Parameter
from pianobot_ros.piano_twin.effects.base import Title, by_name, family

FAMILY = family(
    Title("joint_backlash", "hand", "play in the finger's joints"),
    [Parameter("joint_backlash", 0.0, 0.0, 0.15, "rad", sd=0.01)],
    [{"joint_backlash": x} for x in (0.002, 0.01, 0.03)],
    mechanics=by_name,
)
