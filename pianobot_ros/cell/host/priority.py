"""Scheduling class of processes and threads.

Three classes. *Real-time*: loops with a deadline of milliseconds (the arm's stream, the physics,
the emulated devices); nothing ordinary delays them. *High*: the rest of the live cell; a nice value
below that of ordinary programs. *Background*: long searches and reports; they get what the others
leave. The first two need root or ``CAP_SYS_NICE``; without it nothing changes.
"""

from __future__ import annotations

import contextlib
import os
import sys
import threading
from collections.abc import Iterable, Iterator
from pathlib import Path

__all__ = [
    "REALTIME_PRIORITY",
    "cores",
    "ordinary",
    "request_background",
    "request_default",
    "request_high",
    "request_realtime",
    "thread_ids",
]

# Nice values; an ordinary program leaves 5 a quarter of a core, 10 a tenth.
NICE_HIGH, NICE_BACKGROUND = -10, 5
REALTIME_PRIORITY = 2  # any is above all ordinary ones; 1 to 4 are used, see docs/graph.md


def cores() -> int:
    """How many cores this process may use: in a container often fewer than the machine has."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def thread_ids(process: int = 0) -> set[int]:
    """Ids of the threads of ``process`` (0: this one); none where the system does not tell."""
    with contextlib.suppress(OSError):
        return {int(entry.name) for entry in Path(f"/proc/{process or 'self'}/task").iterdir()}
    return set()


def request_high() -> bool:
    """Ask for a nice value below that of ordinary programs for the calling thread; returns whether
    that was allowed.

    Threads and processes started from it inherit this. A process that leads a session asks for all
    of that, too: Linux shares time among sessions first (autogroups), and only within one of them
    do nice values count (sched(7)). A node in a session of its own had starved beside others
    whatever its nice value was.
    """
    try:
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICE_HIGH)
    except OSError:
        return False
    if sys.platform == "linux" and os.getsid(0) == os.getpid():
        with contextlib.suppress(OSError):
            Path("/proc/self/autogroup").write_text(str(NICE_HIGH), encoding="ascii")
    return True


def request_realtime(
    process: int = 0,
    *,
    priority: int = REALTIME_PRIORITY,
    threads: Iterable[int] | None = None,
) -> bool:
    """Ask for round-robin real-time scheduling of ``threads`` (None: all present threads of
    ``process``, 0 being this one); returns whether that was allowed.

    Call it once everything is compiled and loaded: a thread that computes for long at this priority
    stops the machine (but for the twentieth that Linux keeps for the rest). Later threads and
    children inherit it.
    """
    if not hasattr(os, "sched_setscheduler"):
        return False
    try:
        for thread in thread_ids(process) if threads is None else threads:
            with contextlib.suppress(ProcessLookupError):
                os.sched_setscheduler(thread, os.SCHED_RR, os.sched_param(priority))
    except OSError:
        return False
    return True


def request_default() -> None:
    """Give the calling thread ordinary scheduling: for a process that was started by a real-time
    one, while it loads.
    """
    if hasattr(os, "sched_setscheduler"):
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


@contextlib.contextmanager
def ordinary() -> Iterator[None]:
    """The calling thread has ordinary scheduling for a while: where one with a deadline has to
    compute for long before it begins.
    """
    if not hasattr(os, "sched_setscheduler"):
        yield
        return
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    request_default()
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, policy, parameters)


def request_background() -> None:
    """Let everything else run before the calling thread, and what it starts: for long searches
    beside a running cell.
    """
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICE_BACKGROUND)
    if sys.platform == "linux":
        with contextlib.suppress(OSError):  # it then interrupts nobody when it wakes up
            os.sched_setscheduler(threading.get_native_id(), os.SCHED_BATCH, os.sched_param(0))
