"""What a process leaves behind for the one that follows it, should it be killed."""

from __future__ import annotations

import contextlib
import os
import re

from pianobot_ros.cell.host.memory import memory_folder

__all__ = ["Mark"]


class Mark:
    """A file that is there or not, of this user on this machine, by its ``name``; without one,
    something that this process alone knows.

    A disk that takes no file costs what outlasts the process, and no more: nothing is raised.
    """

    def __init__(self, name: str = "") -> None:
        known = re.sub(r"[^A-Za-z0-9._-]", "_", name)
        file = memory_folder() / f"pianobot-{os.getuid()}-{known}"
        self._path = file if name else None
        self._there = self._path is not None and self._path.exists()

    def __bool__(self) -> bool:
        return self._there

    def set(self, there: bool = True) -> None:
        """Leave it, or take it away."""
        if there == self._there:
            return
        self._there = there
        if self._path is not None:
            with contextlib.suppress(OSError):
                if there:
                    self._path.touch(0o600)
                else:
                    self._path.unlink(missing_ok=True)
