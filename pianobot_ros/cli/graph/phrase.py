"""One phrase from its goal to its result, for whoever asks the conductor to play."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from pianobot_ros.cell.errors import PianobotError

if TYPE_CHECKING:
    from pianobot_ros.nodes.watching.observer import Observer

__all__ = ["played", "silent"]

ANSWER = 20.0  # s; a busy conductor takes some to accept a goal
LAST = 3.0  # s for a phrase that was cancelled to end
GONE = "the conductor ended, and the phrase with it: its log may say why; play the phrase again"
UNDER_WAY = 1.0  # s for the result of a conductor that said it and left

Wait = Callable[[Callable[[], Any], float, Callable[[], str]], Any]
"""Waits for a condition, so many s at most; raises an error with the words else."""


def silent() -> str:
    """What is said of a conductor that does not answer."""
    return "the conductor does not answer"


def played(observer: Observer, goal: Any, wait: Wait, limit: float, progress: Any = None) -> Any:
    """Result of the action. Whatever ends the waiting, Ctrl-C or ``limit`` s, cancels the phrase,
    which else plays on. Raises :class:`PianobotError` where another phrase is under way, and where
    the conductor is gone: one that is started in its place knows nothing of the phrase.
    """
    from pianobot_ros.nodes.base.jobs import cancel  # loads the middleware

    accepted, result = observer.send(goal, progress), None
    try:
        wait(accepted.done, ANSWER, silent)
        handle = accepted.result()
        if not handle.accepted:
            raise PianobotError("the conductor is playing already: wait, or cancel that phrase")
        plays, result = observer.conductors(), handle.get_result_async()
        wait(
            lambda: result.done() or (plays and not plays & observer.conductors()),
            limit,
            lambda: "the phrase did not end in time",
        )
        wait(result.done, UNDER_WAY, lambda: GONE)
    except Exception:
        accepted.add_done_callback(cancel)  # it may have begun though its answer is on the way
        end = time.monotonic() + LAST
        while not (result and result.done()) and time.monotonic() < end:
            observer.spin(0.05)
        raise
    return result.result().result
