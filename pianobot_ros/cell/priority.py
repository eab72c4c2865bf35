"""Scheduling of threads that keep time, and of those that may wait.

Three classes. *Pace*: loops that must run within a millisecond of their time (the arm's stream, the physics, the emulated arm
and plant); real-time scheduling, so nothing ordinary delays them. *Time*: everything else of the live cell; before ordinary
programs. *Wait*: long searches and reports; they get what the others leave.
"""

from __future__ import annotations

import contextlib
import os
import sys
import threading
from pathlib import Path

__all__ = ["keep_pace", "keep_time", "may_wait", "start_up"]

FIRST, LAST = -10, 19  # nice values
PACE = 2  # real-time priority; any is above all ordinary ones


def keep_time() -> bool:
    """Ask that the calling thread runs before ordinary ones; returns whether that was allowed (root, or CAP_SYS_NICE).

    Threads and processes started from it inherit this. Without the right nothing changes.
    """
    try:
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), FIRST)
    except OSError:
        return False
    return True


def keep_pace(process: int = 0, *, priority: int = PACE) -> bool:
    """Ask for real-time scheduling of all present threads of ``process`` (0: this one); returns whether that was allowed.

    Call it once everything is compiled and loaded: a thread that computes for long at this priority stops the machine (but for
    the twentieth that Linux keeps for the rest). Later threads and children inherit it.
    """
    if not hasattr(os, "sched_setscheduler"):
        return False
    threads = [int(entry.name) for entry in Path(f"/proc/{process or 'self'}/task").iterdir()]
    try:
        for thread in threads:
            with contextlib.suppress(ProcessLookupError):
                os.sched_setscheduler(thread, os.SCHED_RR, os.sched_param(priority))
    except OSError:
        return False
    return True


def start_up() -> None:
    """For a process that was started by one that keeps pace: it does not while it loads."""
    if hasattr(os, "sched_setscheduler"):
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def may_wait() -> None:
    """Let everything else run before the calling thread, and what it starts: for long searches beside a running cell."""
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), LAST)
    if sys.platform == "linux":
        with contextlib.suppress(OSError):  # a busy machine then runs it only where a processor is idle
            os.sched_setscheduler(threading.get_native_id(), os.SCHED_BATCH, os.sched_param(0))
