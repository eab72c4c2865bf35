"""A thread that does not end with an error that nobody foresaw."""

from __future__ import annotations

import contextlib
import threading
import time
import traceback
from collections.abc import Callable
from pathlib import Path

__all__ = ["Attended", "in_one_line"]


def in_one_line(error: BaseException) -> str:
    """What happened and where, for a log that has one line for it."""
    frames = traceback.extract_tb(error.__traceback__)
    where = f" in {Path(frames[-1].filename).name}:{frames[-1].lineno}" if frames else ""
    return f"{type(error).__name__}: {' '.join(str(error).split())}{where}"


class Attended(threading.Thread):
    """A daemon thread that calls ``work``; if that raises, it says so and calls it again.

    A device's thread that died would leave a node that looks alive and publishes nothing for ever.
    ``work`` must cope with being begun anew and returns when it is to end.

    Args:
        work: what the thread does.
        name: its name.
        on_fault: called on the thread with one line about the error, before ``work`` is called
            again.
        pause: s between an error and the next call.
    """

    def __init__(
        self,
        work: Callable[[], None],
        name: str,
        on_fault: Callable[[str], None],
        pause: float = 0.1,
    ) -> None:
        super().__init__(name=name, daemon=True)
        self._work, self._on_fault, self._pause = work, on_fault, pause
        self.faults = 0

    def run(self) -> None:
        """Work, and begin again after an error."""
        while True:
            try:
                self._work()
            except Exception as error:
                self.faults += 1
                with contextlib.suppress(Exception):  # whoever listens may be on its way out
                    self._on_fault(in_one_line(error))
                time.sleep(self._pause)
            else:
                return
