"""A node's word about the commands that it refused, and who listens to it."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Sequence

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from pianobot_msgs.msg import StrikeMark
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from pianobot_ros.messages.refusals import COMMAND_KEY, Refusal, one_sided, refusals
from pianobot_ros.messages.stamps import nanoseconds, seconds
from pianobot_ros.nodes.notes import EVENTS
from pianobot_ros.nodes.polled import PolledSubscription, stream_qos
from pianobot_ros.nodes.qos import EVENT_QOS

__all__ = ["OneSidedRefusals", "RefusalPublisher"]

_LOG_PERIOD = 1.0  # s between two log lines about one topic
_KEPT = 5000  # refusals of one cell that are remembered


class RefusalPublisher:
    """Counts, logs and publishes what a node of ``cell`` (``real`` or ``sim``) refuses.

    ``count`` and ``last`` (the reason) are for the node's diagnostics.
    """

    def __init__(self, node: Node, cell: str) -> None:
        self._node = node
        # not a lifecycle publisher: it speaks in every state
        self._publisher = Node.create_publisher(
            node, DiagnosticArray, f"/{cell}/refusals", EVENT_QOS
        )
        self._logged: dict[str, float] = {}
        self.count = 0
        self.last = ""

    def refuse(self, topic: str, stamp: Time, reason: object) -> None:
        """One command with this stamp was not obeyed."""
        self.count += 1
        self.last = str(reason)[:300]
        now = time.monotonic()
        if now - self._logged.get(topic, float("-inf")) > _LOG_PERIOD:
            self._logged[topic] = now
            self._node.get_logger().warning(f"command rejected: {self.last}")
        name = f"{self._node.get_fully_qualified_name().lstrip('/')}: {topic}"
        key = KeyValue(key=COMMAND_KEY, value=str(max(0, nanoseconds(stamp))))
        array = DiagnosticArray(
            status=[
                DiagnosticStatus(
                    level=DiagnosticStatus.WARN, name=name, message=self.last, values=[key]
                )
            ]
        )
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)


class OneSidedRefusals:
    """Hears what both ``cells`` refuse: in a strike of which one alone refused a command they are
    not comparable. ``count`` of such strikes and ``last`` (why) are for the node's diagnostics.
    """

    def __init__(self, node: Node, cells: Sequence[str]) -> None:
        self._streams = {
            cell: PolledSubscription(
                node, DiagnosticArray, f"/{cell}/refusals", stream_qos(EVENTS, reliable=True)
            )
            for cell in cells
        }
        self._heard: dict[str, deque[Refusal]] = {cell: deque(maxlen=_KEPT) for cell in cells}
        self.count = 0
        self.last = ""

    def take(self) -> None:
        """Take in what has arrived."""
        for cell, stream in self._streams.items():
            for taken in stream.take():
                self._heard[cell] += refusals(deserialize_message(taken.data, DiagnosticArray))

    def spoil(self, mark: StrikeMark) -> bool:
        """Whether one cell alone refused a command of this strike; counted if so."""
        start, end = seconds(mark.header.stamp), seconds(mark.end)
        found = one_sided(self._heard["real"], self._heard["sim"], start, end)
        if found is None:
            return False
        cell, refusal = found
        self.count += 1
        self.last = f"the {cell} cell alone refused {refusal.topic}: {refusal.reason}"
        return True
