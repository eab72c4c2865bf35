"""Who watches the supervisor: while it stands still (Ctrl-Z, SIGSTOP), nobody starts anew what
dies.
"""

from __future__ import annotations

import os

from rclpy.node import Node

from pianobot_ros.cell.host.halted import SUPERVISOR, halted
from pianobot_ros.nodes.topics.polled import Beat

__all__ = ["SupervisorWatch"]

PERIOD = 0.25  # s between two looks


class SupervisorWatch:
    """Says in the node's log when the supervisor that started it stands still, and when it goes on.

    Nothing is watched where no supervisor has started the node.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._pid = os.getppid()
        self._stands = False
        self._beat: Beat | None = None
        if os.environ.get(SUPERVISOR) == str(self._pid):
            self._beat = Beat(node, self._look, PERIOD, "supervisor")
            self._beat.start()

    def close(self) -> None:
        """Look no more. Safe to call twice."""
        beat, self._beat = self._beat, None
        if beat is not None:
            beat.close()

    def _look(self) -> None:
        stands = halted(self._pid)
        if stands and not self._stands:
            self._node.get_logger().warning(
                f"the supervisor (process {self._pid}) stands still: nodes that die are not started"
                f" anew; kill -CONT {self._pid} lets it go on"
            )
        elif self._stands and not stands:
            self._node.get_logger().info("the supervisor goes on")
        self._stands = stands
