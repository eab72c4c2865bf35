"""A node's word about the commands that it did not obey as given, and who listens to it."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from pianobot_msgs.msg import StrikeMark
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from pianobot_ros.cell.messages.refusals import (
    COMMAND_KEY,
    LASTING,
    LASTING_KEY,
    Refusal,
    one_sided,
    refusals,
)
from pianobot_ros.cell.messages.stamps import nanoseconds, seconds
from pianobot_ros.devices.base import CommandRejectedError, DeviceUnavailableError
from pianobot_ros.devices.wrist.rtde.setpoint_stream import CATCH_UP
from pianobot_ros.nodes.session.lost_strikes import LATE
from pianobot_ros.nodes.session.notes import EVENTS
from pianobot_ros.nodes.topics.polled import PolledSubscription, stream_qos
from pianobot_ros.nodes.topics.qos import EVENT_QOS

__all__ = ["OneSidedRefusals", "RefusalPublisher"]

_LOG_PERIOD = 1.0  # s between two log lines about one topic
_KEPT = 5000  # refusals of one cell that are remembered
_AGAIN = 0.2  # s between two words about an arm that is behind
_CAUGHT_UP = 1.0 + 1.0 / (CATCH_UP - 1.0)  # times what it is behind: held, and caught up with
# s for which a clamped command shows: of a stream the next ones are clamped too, and told
_CLAMPED = {"/command/wrist": 0.1}


class RefusalPublisher:
    """Counts, logs and publishes what a node of ``cell`` (``real`` or ``sim``) does not obey as
    given.

    ``count`` and ``last`` (the reason) of what it refused, and ``late``, how often it was behind,
    are for the node's diagnostics.
    """

    def __init__(self, node: Node, cell: str) -> None:
        self._node = node
        # not a lifecycle publisher: it speaks in every state
        self._publisher = Node.create_publisher(
            node, DiagnosticArray, f"/{cell}/refusals", EVENT_QOS
        )
        self._logged: dict[str, float] = {}
        self._said = float("-inf")
        self.count = self.late = 0
        self.last = ""

    def refuse(self, topic: str, stamp: Time, reason: object) -> None:
        """One command with this stamp was not obeyed."""
        self.count += 1
        self.last = str(reason)[:300]
        now = time.monotonic()
        if now - self._logged.get(topic, float("-inf")) > _LOG_PERIOD:
            self._logged[topic] = now
            self._node.get_logger().warning(f"command rejected: {self.last}")
        values = {COMMAND_KEY: str(max(0, nanoseconds(stamp)))}
        self._publish(topic, self.last, values)

    @contextmanager
    def of_driver(self, topic: str, stamp: Time, lost: str) -> Iterator[None]:
        """Refuse the command with this stamp where the driver rejects it within, or has no device:
        it is ``lost``, in words.
        """
        try:
            yield
        except CommandRejectedError as error:
            self.refuse(topic, stamp, error)
        except DeviceUnavailableError as error:
            self.refuse(topic, stamp, f"{lost}: {error}")

    def behind(self, topic: str, now: int, behind: float) -> None:
        """The arm is ``behind`` s after its setpoints at ``now``, ns since the epoch: what it
        plays until it has caught up is not what was asked for.
        """
        if behind <= LATE or now < self._said + 1e9 * _AGAIN:
            return
        self._said, self.late = now, self.late + 1
        began = now - round(1e9 * behind)
        reason = f"obeyed {1e3 * behind:.0f} ms late, since this machine was busy"
        lasting = _CAUGHT_UP * behind + _AGAIN
        values = {COMMAND_KEY: str(began), LASTING_KEY: f"{lasting:.3f}"}
        self._publish(topic, reason, values)

    def clamped(self, topic: str, stamp: Time, limit: str) -> None:
        """The command with this stamp was obeyed only as far as ``limit`` allows."""
        values = {
            COMMAND_KEY: str(max(0, nanoseconds(stamp))),
            LASTING_KEY: f"{_CLAMPED.get(topic, LASTING):.3f}",
        }
        self._publish(topic, f"clamped by the {limit} limit", values)

    def _publish(self, topic: str, reason: str, values: Mapping[str, str]) -> None:
        status = DiagnosticStatus(
            level=DiagnosticStatus.WARN,
            name=f"{self._node.get_fully_qualified_name().lstrip('/')}: {topic}",
            message=reason,
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)


class OneSidedRefusals:
    """Hears what both ``cells`` do not obey as given: in a strike of which one alone did not obey
    a command they are not comparable. ``count`` of such strikes and ``last`` (why) are for the
    node's diagnostics.
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

    def between(self, start: float, end: float) -> str:
        """What one cell alone did not obey between ``start`` and ``end``, s since the epoch, in
        words; empty if nothing.
        """
        found = one_sided(self._heard["real"], self._heard["sim"], start, end)
        if found is None:
            return ""
        cell, refusal = found
        return f"the {cell} cell alone did not obey {refusal.topic}: {refusal.reason}"

    def spoil(self, mark: StrikeMark) -> bool:
        """Whether one cell alone did not obey a command of this strike; counted if so."""
        found = self.between(seconds(mark.header.stamp), seconds(mark.end))
        self.last = found or self.last
        self.count += bool(found)
        return bool(found)
