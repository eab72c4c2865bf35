"""What a running session shows of its devices' clocks: a stamp beside the host's time at which the
message was sent.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

from rclpy.node import Node
from sensor_msgs.msg import TimeReference

from pianobot_ros.cell.messages.stamps import first_stamp
from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.topics.polled import Taken

__all__ = ["CLOCKS", "ClockSights"]

CLOCKS = "/gap/clocks"
PERIOD = 1.0  # s, of which the message with the least delay is told


class ClockSights:
    """Publishes one TimeReference a device and second: ``source`` the device, ``time_ref`` its
    stamp, ``header`` when the message was sent.
    """

    def __init__(self, node: Node) -> None:
        self._publisher = node.create_publisher(TimeReference, CLOCKS, common.EVENT_QOS)
        self._best: dict[str, tuple[int, int]] = {}
        self._due = time.monotonic() + PERIOD

    def note(self, device: str, messages: Sequence[Taken]) -> None:
        """What ``device`` sent since the last call."""
        for taken in messages:
            stamp = first_stamp(taken.data)
            best = self._best.get(device)
            if best is None or taken.sent - stamp < best[1] - best[0]:
                self._best[device] = stamp, taken.sent

    def tell(self) -> None:
        """Publish if a second has passed."""
        now = time.monotonic()
        if now < self._due:
            return
        self._due = now + PERIOD
        for device, (stamp, sent) in self._best.items():
            message = TimeReference(time_ref=common.time_msg(stamp), source=device)
            message.header.stamp = common.time_msg(sent)
            self._publisher.publish(message)
        self._best.clear()
