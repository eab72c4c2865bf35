"""Which effects of the library the columns of a joint's logs can tell."""

from __future__ import annotations

from dataclasses import replace

from pianobot_ros.axis.commissioning.commissioned import Commissioned
from pianobot_ros.axis.laws import library
from pianobot_ros.axis.laws.load import contact, payload
from pianobot_ros.gap import Effect

__all__ = ["observable_effects"]

OF_COMMAND = (
    "deadband",
    "torque_limit",
    "speed_limit",
    "friction_compensation",
    "position_offset",
    "contact",
)
"""Effects that show only beside a command, as do those of the stages command and clock."""
WHERE = ("backlash_output", "elastic_output")
"""Parameters that say on which side of the gear the encoder sits."""
OF_EFFORT = ("torque_droop", "sensor_latency")
"""Effects that show only in a measured effort."""


def observable_effects(joint: Commissioned, reference: bool) -> list[Effect]:
    """The effects of the library that the logs of this joint can tell; with a ``reference`` also
    those of what has changed since.
    """
    out = []
    more = []
    if reference:
        more.append(payload.effect(joint.scales, joint.others.carries(joint.logs[0].log)))
    if joint.others.contact is not None:
        more.append(contact.effect(joint.scales, joint.others.contact))
    for e in (*library(joint.scales), *more):
        needs_command = e.stage in ("command", "clock") or e.name in OF_COMMAND
        if (needs_command and not joint.has("command")) or (
            e.name in OF_EFFORT and not joint.has("effort")
        ):
            continue
        if e.name == "arm_gravity" and (not joint.others.arm or joint.has("model")):
            continue
        if e.name == "carried_load" and not joint.scales.carried:
            continue
        if e.name == "end_stop" and not joint.scales.stop:
            continue
        if e.name in ("gravity", "arm_gravity") and joint.unit == "m":
            continue
        out.append(_in_metres(e) if joint.unit == "m" else e)
    if joint.has("twist"):
        out = [_at_the_motor(e) for e in out]
    return out


def _at_the_motor(e: Effect) -> Effect:
    """An effect of a joint whose motor has the encoder that is compared, so that where it sits is
    not asked.
    """
    own = tuple(p for p in e.parameters if p.name not in WHERE)
    known = {p.name for p in own}
    starts = [{n: x for n, x in start.items() if n in known} for start in e.starts]
    once = tuple({tuple(sorted(start.items())): start for start in starts}.values())
    return replace(e, parameters=own, starts=once)


def _in_metres(e: Effect) -> Effect:
    """An effect of a linear axis: rad are m."""
    own = tuple(
        p if p.name.endswith("_phase") else replace(p, unit=p.unit.replace("rad", "m"))
        for p in e.parameters
    )
    return replace(e, parameters=own)
