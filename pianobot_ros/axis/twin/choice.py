"""Which effects of the library the columns of a joint's logs can tell."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from pianobot_ros.axis.laws import library
from pianobot_ros.axis.laws.load import contact, payload
from pianobot_ros.gap import Effect

if TYPE_CHECKING:
    from pianobot_ros.axis.twin.servo_axis import ServoAxis

__all__ = ["told_by"]

OF_COMMAND = (
    "deadband",
    "torque_limit",
    "speed_limit",
    "friction_compensation",
    "position_offset",
    "contact",
)
"""Effects that show only beside a command, as do those of the stages command and clock."""
OF_EFFORT = ("torque_droop", "sensor_latency")
"""Effects that show only in a measured effort."""


def told_by(axis: ServoAxis, reference: bool) -> list[Effect]:
    """The effects of the library that the logs of this joint can tell; with a ``reference`` also
    those of what has changed since.
    """
    out = []
    more = [payload.effect(axis.scales, axis.others.carries(axis.logs[0].log))] if reference else []
    if axis.others.contact is not None:
        more.append(contact.effect(axis.scales, axis.others.contact))
    for e in (*library(axis.scales), *more):
        needs_command = e.stage in ("command", "clock") or e.name in OF_COMMAND
        if (needs_command and not axis.has_command) or (
            e.name in OF_EFFORT and not axis.has_effort
        ):
            continue
        if e.name == "arm_gravity" and (not axis.others.arm or axis.has_model):
            continue
        if e.name in ("gravity", "arm_gravity") and axis.unit == "m":
            continue
        out.append(_in_metres(e) if axis.unit == "m" else e)
    return out


def _in_metres(e: Effect) -> Effect:
    """An effect of a linear axis: rad are m."""
    own = tuple(replace(p, unit=p.unit.replace("rad", "m")) for p in e.parameters)
    return replace(e, parameters=own)
