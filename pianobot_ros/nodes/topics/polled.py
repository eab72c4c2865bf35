"""Subscriptions that are emptied at a beat of their own instead of waking the executor for every
message.

A wake-up of rclpy's executor costs a millisecond, ten times as much as taking a message, because it
looks at every entity of the node. Nodes that only store fast streams (``gap_monitor``,
``recorder``) take raw bytes at a slow beat, on a thread beside the executor, and leave the decoding
for when it is needed.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from rclpy.callback_groups import CallbackGroup, ReentrantCallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

from pianobot_ros.nodes.topics.qos import subscription_events

__all__ = ["Beat", "PolledSubscription", "Taken", "Watch", "stream_qos"]


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


class Taken(NamedTuple):
    """A serialized message, with the times at which it was sent and at which it arrived in this
    process, ns since the epoch.
    """

    data: bytes
    sent: int
    received: int


class PolledSubscription:
    """A raw subscription; :meth:`take` returns what has arrived since the last call."""

    def __init__(self, node: Node, kind: Any, topic: str, qos: QoSProfile) -> None:
        self.topic, self.kind = topic, kind
        self.node = node
        self._subscription = node.create_subscription(
            kind,
            topic,
            lambda _: None,
            qos,
            raw=True,
            callback_group=_NeverReady(),
            event_callbacks=subscription_events(node, topic),
        )
        self._depth = qos.depth

    def take(self) -> list[Taken]:
        """What has arrived since the last call, oldest first."""
        taken = []
        handle, kind = self._subscription.handle, self.kind
        with handle:
            for _ in range(self._depth):
                found = handle.take_message(kind, True)
                if found is None:
                    break
                data, info = found
                taken.append(Taken(data, info["source_timestamp"], info["received_timestamp"]))
        return taken

    def destroy(self) -> None:
        """Stop listening."""
        self.node.destroy_subscription(self._subscription)


class Beat:
    """Calls ``work`` every ``period`` s on a thread of its own, from :meth:`start` to :meth:`close`
    or the node's end.

    ``period`` may be changed at any time. What ``work`` raises is raised by the node's executor, as
    if a timer had called it.
    """

    def __init__(self, node: Node, work: Callable[[], None], period: float, name: str) -> None:
        self.period = period
        self._work = work
        self._closing = threading.Event()
        self._error: Exception | None = None
        self._alarm = node.create_guard_condition(
            self._complain, callback_group=ReentrantCallbackGroup()
        )
        self._node = node
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def close(self) -> None:
        """End the calls, and wait for one that is under way."""
        self._closing.set()
        if self._thread is not threading.current_thread():
            self._thread.join()
        self._node.destroy_guard_condition(self._alarm)

    def _run(self) -> None:
        try:
            while not self._closing.is_set():
                self._work()
                time.sleep(self.period)  # unlike waiting for the event, this is one system call
        except InvalidHandle:  # the node was destroyed meanwhile
            return
        except Exception as error:
            self._error = error
            self._alarm.trigger()

    def _complain(self) -> None:
        if self._error is not None:
            raise self._error


class Watch:
    """Hands the messages of a stream to ``callback`` from a :class:`Beat` that looks for them every
    ``period`` s; or after as many s as ``period`` says of what a look has found.

    ``read`` makes of what was taken what ``callback`` gets, by default the message.
    """

    def __init__(
        self,
        stream: PolledSubscription,
        callback: Callable[[Any], None],
        period: float | Callable[[Sequence[Taken]], float],
        read: Callable[[Taken], Any] | None = None,
    ) -> None:
        self._stream, self._callback = stream, callback
        self._read = read or (lambda taken: deserialize_message(taken.data, stream.kind))
        self._pause = period if callable(period) else lambda _: period
        self._beat = Beat(stream.node, self._look, self._pause(()), f"watch {stream.topic}")
        self._beat.start()

    def close(self) -> None:
        """Stop listening."""
        self._beat.close()
        self._stream.destroy()

    def _look(self) -> None:
        found = self._stream.take()
        for taken in found:
            self._callback(self._read(taken))
        self._beat.period = self._pause(found)
