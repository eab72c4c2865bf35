"""The one way to wait in a test: for a condition, never for a time."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

__all__ = ["TIMEOUT", "NotInTime", "wait_for"]

T = TypeVar("T")

TIMEOUT = 100.0
"""s that a busy machine may need for any single step. A test that passes does not wait for it."""

POLL = 0.005  # s between two looks where nothing else paces them


class NotInTime(AssertionError):  # noqa: N818 (pytest shows it as a failure)
    """What a test waited for has not happened, or can no longer happen."""


def _pause() -> None:
    time.sleep(POLL)


def wait_for(
    condition: Callable[[], T],
    what: str | Callable[[], str] = "",
    timeout: float = TIMEOUT,
    *,
    turn: Callable[[], object] = _pause,
    trouble: Callable[[], str] | None = None,
) -> T:
    """The first true value of ``condition``, which is asked again and again.

    Args:
        condition: called often; what it returns is returned once it is true.
        what: names the condition in the failure; a function is called only then.
        timeout: s.
        turn: called between two looks: lets messages in, or sleeps a little.
        trouble: why waiting is in vain, or an empty string. A test whose node has died fails at
            once and with the node's own words, not after ``timeout``.

    Raises:
        NotInTime: an AssertionError that says what did not come, and why if that is known.
    """
    end = time.monotonic() + timeout
    while not (value := condition()):
        late = time.monotonic() >= end
        why = trouble() if trouble else ""
        # What ended may have done its duty just before.
        if (late or why) and not (value := condition()):
            name = what() if callable(what) else what or getattr(condition, "__name__", "")
            limit = why or f"not within {timeout:g} s"
            raise NotInTime(f"{name}: {limit}")
        if value:
            break
        turn()
    return value
