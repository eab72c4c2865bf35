"""A way out of a process that cannot end.

Fast DDS sometimes stops for good while a participant is destroyed and others come and go (seen once
in some thousands; issue 6193 of Fast DDS is of this kind). rclpy holds Python's lock meanwhile, so
that no thread of Python could end the process. A timer of the system can.
"""

from __future__ import annotations

import contextlib
import ctypes
import sys
import time
from collections.abc import Iterator

__all__ = ["way_out"]

LIMIT = 5.0  # s; a busy machine takes one
THREAD = 2  # SIGEV_THREAD of signal.h


class _Event(ctypes.Structure):
    """``struct sigevent`` of signal.h on Linux, 64 bytes."""

    _fields_ = (
        ("value", ctypes.c_int),
        ("value_rest", ctypes.c_int),
        ("signal", ctypes.c_int),
        ("notify", ctypes.c_int),
        ("function", ctypes.c_void_p),
        ("attributes", ctypes.c_void_p),
        ("rest", ctypes.c_byte * 32),
    )


@contextlib.contextmanager
def way_out(code: int, seconds: float = LIMIT) -> Iterator[None]:
    """If the body takes longer than ``seconds`` the process ends with ``code``, whatever the body
    waits for. Nothing is tidied up then: do first what must not be lost. Elsewhere than on Linux
    the body may take as long as it likes.
    """
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):  # closed, or nobody reads it any more
            stream.flush()
    if sys.platform != "linux":
        yield
        return
    system = ctypes.CDLL(None, use_errno=True)
    # The system starts a thread in which it calls the C library's function with the code.
    leave = ctypes.cast(system._exit, ctypes.c_void_p)
    event = _Event(value=code, notify=THREAD, function=leave.value)
    timer = ctypes.c_void_p()
    if system.timer_create(time.CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer)):
        yield  # no timers left: without a limit, as everywhere else
        return
    # struct itimerspec: no interval, then s and ns until it ends
    times = (ctypes.c_long * 4)(0, 0, int(seconds), int(seconds % 1.0 * 1e9))
    system.timer_settime(timer, 0, times, None)
    try:
        yield
    finally:
        system.timer_delete(timer)
