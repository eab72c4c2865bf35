"""``/diagnostics`` at 1 Hz."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from pianobot_ros.devices.base import Health

__all__ = ["Diagnostics"]


class Diagnostics:
    """Publishes what ``collect`` says about each part of a node.

    Args:
        node: the node that reports.
        hardware_id: address or serial number of the device; empty for a node without one.
        collect: returns a health for each part, by name.
        period_s: seconds between reports.
    """

    def __init__(
        self,
        node: Node,
        hardware_id: str,
        collect: Callable[[], Mapping[str, Health]],
        period_s: float = 1.0,
    ) -> None:
        self._node = node
        self.hardware_id = hardware_id
        self._collect = collect
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._timer = node.create_timer(period_s, self.publish)

    def publish(self) -> None:
        """Publish now; also worth calling when something important changes."""
        array = DiagnosticArray()
        array.header.stamp = self._node.get_clock().now().to_msg()
        array.status = [self._status(part, health) for part, health in self._collect().items()]
        self._publisher.publish(array)

    def _status(self, part: str, health: Health) -> DiagnosticStatus:
        values = {
            "age_s": f"{health.age_s:.4f}",
            **{key: _text(value) for key, value in health.values.items()},
        }
        return DiagnosticStatus(
            level=bytes([int(health.level)]),
            name=f"{self._node.get_fully_qualified_name().lstrip('/')}: {part}",
            message=health.message,
            hardware_id=self.hardware_id,
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )


def _text(value: float | int | str) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
