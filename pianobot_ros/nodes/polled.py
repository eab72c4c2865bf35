"""Subscriptions that are emptied by a timer instead of waking the executor for every message.

A wake-up of rclpy's executor costs ten times as much as taking a message. Nodes that only store fast streams
(``gap_monitor``, ``recorder``) take raw bytes at a slow beat and leave the decoding for when it is needed.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

from pianobot_ros.nodes.qos import subscription_events

__all__ = ["PolledSubscription", "Watch", "stream_qos"]


class _NeverReady(CallbackGroup):
    """Keeps its subscriptions out of the executor's wait set."""

    def can_execute(self, entity: Any) -> bool:
        return False

    def beginning_execution(self, entity: Any) -> bool:
        return False

    def ending_execution(self, entity: Any) -> None:
        pass


def stream_qos(depth: int, reliable: bool = False) -> QoSProfile:
    """Deep enough to hold what arrives between two polls."""
    reliability = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
    return QoSProfile(depth=depth, history=HistoryPolicy.KEEP_LAST, reliability=reliability)


class PolledSubscription:
    """A raw subscription; :meth:`take` returns what has arrived since the last call."""

    def __init__(self, node: Node, kind: Any, topic: str, qos: QoSProfile) -> None:
        self.topic, self.kind = topic, kind
        self._node = node
        self._subscription = node.create_subscription(
            kind, topic, lambda _: None, qos, raw=True, callback_group=_NeverReady(),
            event_callbacks=subscription_events(node, topic),
        )  # fmt: skip
        self._depth = qos.depth

    def take(self) -> list[tuple[bytes, int]]:
        """Serialized messages with the time at which each was sent, ns since the epoch, oldest first."""
        taken = []
        handle = self._subscription.handle
        with handle:
            for _ in range(self._depth):
                found = handle.take_message(self.kind, True)
                if found is None:
                    break
                data, info = found
                taken.append((bytes(data), int(info["source_timestamp"])))
        return taken

    def destroy(self) -> None:
        """Stop listening."""
        self._node.destroy_subscription(self._subscription)


class Watch:
    """Hands the messages of a stream to ``callback`` from a thread that looks for them every ``period`` s, until :meth:`close`.

    For streams of commands: the executor needs a millisecond for each message, this a twentieth of it.
    """

    def __init__(self, stream: PolledSubscription, callback: Callable[[Any], None], period: float) -> None:
        self._stream, self._callback, self._period = stream, callback, period
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"watch {stream.topic}", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop listening."""
        self._closing.set()
        self._thread.join()
        self._stream.destroy()

    def _run(self) -> None:
        while not self._closing.is_set():
            for data, _ in self._stream.take():
                self._callback(deserialize_message(data, self._stream.kind))
            time.sleep(self._period)
