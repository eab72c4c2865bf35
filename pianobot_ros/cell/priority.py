"""Scheduling priority of threads that keep time, and of those that may wait."""

from __future__ import annotations

import contextlib
import os
import threading

__all__ = ["keep_time", "may_wait"]

FIRST, LAST = -10, 10  # nice values


def keep_time() -> bool:
    """Ask that the calling thread runs before ordinary ones; returns whether that was allowed (root, or CAP_SYS_NICE).

    For loops with a deadline: the arm's stream, the physics, the emulated devices. Without the right nothing changes.
    """
    try:
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), FIRST)
    except OSError:
        return False
    return True


def may_wait() -> None:
    """Let everything else run before the calling thread: for long searches beside a running cell."""
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), LAST)
