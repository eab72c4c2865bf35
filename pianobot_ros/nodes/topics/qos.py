"""Quality of service: one choice for each kind of topic, and a log line when two ends do not
fit.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSProfile,
    ReliabilityPolicy,
    qos_policy_name_from_kind,
)

__all__ = [
    "COMMAND_DEADLINE_S",
    "COMMAND_QOS",
    "EVENT_QOS",
    "LATCHED_QOS",
    "SENSOR_QOS",
    "command_publisher_qos",
    "publisher_events",
    "subscription_events",
]

COMMAND_DEADLINE_S = 0.04
"""Longest gap between two setpoints of a stream, seconds; a longer one is a stale command."""

COMMAND_DEPTH = 1000
"""Setpoints that a publisher keeps for listeners that are late: 8 s, as the middleware may take 3
to find out.
"""

COMMAND_QOS = QoSProfile(
    depth=1, history=HistoryPolicy.KEEP_LAST, reliability=ReliabilityPolicy.RELIABLE
)
"""For subscribers of commands. It requests no deadline, so that a publisher that offers none
(``ros2 topic pub``) is heard too; the driver watches the age of the setpoint itself."""

SENSOR_QOS = QoSProfile(
    depth=5, history=HistoryPolicy.KEEP_LAST, reliability=ReliabilityPolicy.BEST_EFFORT
)
"""For streams of measurements: the newest matters, a lost one does not."""

EVENT_QOS = QoSProfile(
    depth=200, history=HistoryPolicy.KEEP_LAST, reliability=ReliabilityPolicy.RELIABLE
)
"""For events of which none may be lost: MIDI, keystrokes, strike marks."""

LATCHED_QOS = QoSProfile(
    depth=1,
    history=HistoryPolicy.KEEP_LAST,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""For results that late subscribers must still see: the diagnosis."""


def command_publisher_qos(deadline_s: float = COMMAND_DEADLINE_S) -> QoSProfile:
    """For publishers of commands: reliable, and a promise to send at least every ``deadline_s``
    seconds.

    Deep, as a reliable publisher forgets what is beyond its depth even if a slow listener (the
    recorder) still wants it.
    """
    return QoSProfile(
        depth=COMMAND_DEPTH,
        history=HistoryPolicy.KEEP_LAST,
        reliability=ReliabilityPolicy.RELIABLE,
        deadline=Duration(nanoseconds=round(deadline_s * 1e9)),
    )


def _incompatible(node: Node, words: tuple[str, str], info: Any) -> None:
    policy = qos_policy_name_from_kind(info.last_policy_kind)
    node.get_logger().warning(f"{words[0]}: its QoS ({policy}) {words[1]}")


def subscription_events(
    node: Node, topic: str, deadline: Callable[[Any], None] | None = None
) -> SubscriptionEventCallbacks:
    """Callbacks for a subscription: an incompatible publisher is logged with the policy at
    fault.
    """

    words = f"a publisher on '{topic}' is ignored", "does not fit; match it to docs/graph.md"
    incompatible = partial(_incompatible, node, words)
    return SubscriptionEventCallbacks(incompatible_qos=incompatible, deadline=deadline)


def publisher_events(
    node: Node, topic: str, deadline: Callable[[Any], None] | None = None
) -> PublisherEventCallbacks:
    """Callbacks for a publisher: an incompatible subscriber is logged with the policy at fault."""

    words = f"a subscriber of '{topic}' gets nothing", "asks for more than is offered"
    incompatible = partial(_incompatible, node, words)
    return PublisherEventCallbacks(incompatible_qos=incompatible, deadline=deadline)
