"""A test's own corner of ROS: a context in a domain of its own, nodes spun together, messages
recorded.
"""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from pianobot_ros.cell.host.closing import Closing
from pianobot_ros.nodes.base.discovery import RANGE, discovery
from pianobot_ros.testing.waiting import TIMEOUT, wait_for

if TYPE_CHECKING:
    import pytest

__all__ = ["DEPTH", "STREAMS", "Ros", "on_this_machine"]

STREAMS = frozenset({"wrist/state", "joint_states", "vacuum/state", "fsr", "key_angle", "status"})
"""Topics below ``/real/`` and ``/sim/`` whose publishers promise no delivery; a subscriber that
asks for it would get nothing."""

DEPTH = 10_000
"""Messages that a recording may be behind."""

TURN = 0.01  # s that one turn waits for a message


def on_this_machine(patch: pytest.MonkeyPatch) -> None:
    """Let this process and its children see nodes of this machine only.

    The middleware reads these settings with the first context of a process.
    """
    patch.setenv(RANGE, "LOCALHOST")
    for name, value in discovery().items():
        patch.setenv(name, value)


class Ros(Closing):
    """A ROS context whose nodes are spun while the test waits. Importing rclpy is left to its
    construction, so that tests without ROS do not pay for it.

    Args:
        domain: ``ROS_DOMAIN_ID``.
        trouble: why waiting is in vain, see :func:`wait_for`.
    """

    def __init__(self, domain: int, trouble: Callable[[], str] | None = None) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.signals import SignalHandlerOptions

        self.domain = domain
        self.context = rclpy.Context()
        rclpy.init(
            context=self.context,
            domain_id=domain,
            signal_handler_options=SignalHandlerOptions.NO,
        )
        self.executor = SingleThreadedExecutor(context=self.context)
        self.nodes: list[Any] = []
        self._trouble = trouble
        self._tester: Any = None
        self._clients: dict[str, Any] = {}

    # Nodes.

    def add(self, node: Any) -> Any:
        """Spin ``node``, made with this ``context``, with the others; destroyed at the end."""
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    def node(self, name: str, **options: Any) -> Any:
        """A plain node."""
        from rclpy.node import Node

        return self.add(Node(name, context=self.context, **options))

    @property
    def tester(self) -> Any:
        """The test's own node, for everything below."""
        if self._tester is None:
            self._tester = self.node("tester")
        return self._tester

    # Messages.

    def record(self, kind: Any, topic: str, qos: Any = None) -> list[Any]:
        """A list that fills with the messages of ``topic`` while the test waits: with all that have
        come by then, so that its end is never older than what a slow machine has just brought.

        Args:
            kind: the type of the messages.
            topic: its absolute name.
            qos: by default reliable, and best effort for the topics in ``STREAMS``.
        """
        received: list[Any] = []

        def take(message: Any) -> None:
            received.append(message)
            # one turn of the executor for each would be slower than fast topics
            handle = subscription.handle
            with handle:
                while (found := handle.take_message(kind, False)) is not None:
                    received.append(found[0])

        subscription = self.tester.create_subscription(kind, topic, take, qos or _qos(topic))
        return received

    def publisher(self, kind: Any, topic: str, qos: Any = None) -> Any:
        """A publisher; :meth:`matched` waits for whoever listens to it."""
        return self.tester.create_publisher(kind, topic, qos or _qos(topic))

    def matched(self, *publishers: Any, listeners: int = 1) -> None:
        """Wait until each publisher has ``listeners`` subscribers, and those of the nodes in this
        context know it too; what it publishes before may be lost.
        """
        topics = Counter(p.topic_name for p in publishers)

        def both_ways() -> bool:
            here = [s for n in self.nodes for s in n.subscriptions if s.topic_name in topics]
            return all(p.get_subscription_count() >= listeners for p in publishers) and all(
                s.get_publisher_count() >= topics[s.topic_name] for s in here
            )

        self.wait_for(both_ways, lambda: ", ".join(f"a subscriber of {topic}" for topic in topics))

    def call(self, kind: Any, name: str, request: Any = None, timeout: float = TIMEOUT) -> Any:
        """Wait for a service, call it, and return its answer; ``request`` is empty by default."""
        if name not in self._clients:
            self._clients[name] = self.tester.create_client(kind, name)
        client = self._clients[name]
        self.wait_for(client.service_is_ready, f"service {name}", timeout)
        future = client.call_async(kind.Request() if request is None else request)
        return self.wait_for(future, f"an answer of {name}", timeout)

    # Time.

    def turn(self) -> None:
        """Let messages in, for a hundredth of a second at most."""
        self.executor.spin_once(timeout_sec=TURN)

    def wait_for(
        self,
        condition: Callable[[], Any] | Any,
        what: str | Callable[[], str] = "",
        timeout: float = TIMEOUT,
    ) -> Any:
        """:func:`wait_for` while the nodes are spun; ``condition`` may also be a future, whose
        result is then returned.
        """
        future = None if callable(condition) else condition
        asked = condition if future is None else future.done
        found = wait_for(asked, what or "an answer", timeout, turn=self.turn, trouble=self._trouble)
        return found if future is None else future.result()

    def close(self) -> None:
        """Destroy the nodes and leave the domain. Safe to call twice."""
        import rclpy

        while self.nodes:
            node = self.nodes.pop()
            self.executor.remove_node(node)
            with contextlib.suppress(Exception):
                # As `nodes.run` does: threads of the node end while their streams still exist.
                getattr(node, "shut_down", lambda: None)()
            with contextlib.suppress(Exception):
                node.destroy_node()
        self.executor.shutdown(timeout_sec=1.0)
        rclpy.try_shutdown(context=self.context)


def _qos(topic: str) -> Any:
    from rclpy.qos import QoSProfile, ReliabilityPolicy

    cell, _, name = topic.strip("/").partition("/")
    sure = cell not in ("real", "sim") or name not in STREAMS
    policy = ReliabilityPolicy.RELIABLE if sure else ReliabilityPolicy.BEST_EFFORT
    return QoSProfile(depth=DEPTH, reliability=policy)
