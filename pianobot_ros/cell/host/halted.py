"""What the kernel says of other processes."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterable
from pathlib import Path

import psutil

__all__ = ["SUPERVISOR", "halted", "living", "still_living"]

SUPERVISOR = "PIANOBOT_SUPERVISOR"
"""Name of the environment variable by which a supervisor tells its nodes its process id."""
_LOOK = 0.02  # s between two looks at processes that are to end


def halted(pid: int) -> bool:
    """Whether a signal has stopped the process (a debugger's stop does not count)."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False
    return fields.rpartition(")")[2].split()[:1] == ["T"]


def living(processes: Iterable[psutil.Process]) -> list[psutil.Process]:
    """Those of ``processes`` that have not ended. One that has ended stays known to the kernel
    until its parent asks for its exit code: of an orphan that is the first process of the machine,
    which in a container may be one that never asks.
    """
    found = []
    for process in processes:
        with contextlib.suppress(psutil.NoSuchProcess):
            if process.is_running() and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
    return found


def still_living(processes: Iterable[psutil.Process], limit: float) -> list[psutil.Process]:
    """Those that have not ended within ``limit`` s; returns as soon as all have."""
    left, end = living(processes), time.monotonic() + limit
    while left and time.monotonic() < end:
        time.sleep(_LOOK)
        left = living(left)
    return left
