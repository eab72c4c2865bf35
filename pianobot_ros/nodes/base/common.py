"""What every node shares. Import it as ``from pianobot_ros.nodes import common``.

Hardware nodes derive from :class:`DeviceNode`; the others from :class:`PianoNode`. Both report to
``/diagnostics`` at 1 Hz, refuse unknown parameters, and are run by :func:`run`, which ends them in
order on Ctrl-C.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.node import Node

from pianobot_ros.cell.host.priority import REALTIME_PRIORITY
from pianobot_ros.cell.messages.stamps import first_parts, seconds
from pianobot_ros.devices.base import Health, HealthLevel
from pianobot_ros.nodes.base.device_node import DeviceNode
from pianobot_ros.nodes.base.diagnostics import Diagnostics
from pianobot_ros.nodes.base.node_parameters import check_overrides, declare
from pianobot_ros.nodes.base.running import run
from pianobot_ros.nodes.topics.qos import (
    COMMAND_DEADLINE_S,
    COMMAND_QOS,
    EVENT_QOS,
    LATCHED_QOS,
    SENSOR_QOS,
    command_publisher_qos,
    publisher_events,
    subscription_events,
)

__all__ = [
    "COMMAND_DEADLINE_S",
    "COMMAND_QOS",
    "EVENT_QOS",
    "LATCHED_QOS",
    "REALTIME_PRIORITY",
    "SENSOR_QOS",
    "DeviceNode",
    "Diagnostics",
    "Health",
    "HealthLevel",
    "PianoNode",
    "check_overrides",
    "command_publisher_qos",
    "publisher_events",
    "run",
    "seconds",
    "stamp_of",
    "subscription_events",
    "time_msg",
]


def time_msg(nanoseconds: int) -> Time:
    """A stamp from nanoseconds since the epoch, as ``time.time_ns()`` gives them."""
    return Time(sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000)


def stamp_of(data: bytes) -> Time:
    """The stamp of a serialized message that begins with its header."""
    sec, nanosec = first_parts(data)
    return Time(sec=sec, nanosec=nanosec)


class PianoNode(Node):
    """A node without hardware. Override :meth:`diagnose` and, if there is something to end,
    :meth:`shut_down`.
    """

    declare = declare

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self.diagnostics = Diagnostics(self, "", self.diagnose)

    def diagnose(self) -> Mapping[str, Health]:
        """How each part of the node is doing; published at 1 Hz."""
        return {"node": Health(HealthLevel.OK, "running", age_s=0.0)}

    def shut_down(self) -> None:
        """Called before the node is destroyed, while ROS still works."""
