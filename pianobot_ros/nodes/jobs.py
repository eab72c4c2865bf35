"""Long work beside a spinning executor: a thread of low priority whose end is awaited."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, TypeVar

from rclpy.node import Node
from rclpy.task import Future

from pianobot_ros.cell.priority import may_wait

__all__ = ["background"]

T = TypeVar("T")


def background(node: Node, work: Callable[[], T], name: str) -> Any:
    """A future of what ``work`` returns (or raises), done in a thread of its own that leaves the processor to the others."""
    future: Future = Future(executor=node.executor)

    def run() -> None:
        may_wait()
        try:
            future.set_result(work())
        except Exception as error:
            future.set_exception(error)

    threading.Thread(target=run, name=name, daemon=True).start()
    return future
