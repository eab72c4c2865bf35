"""What a process leaves behind for the one that follows it, should it be killed."""

from __future__ import annotations

import contextlib
import os
import re

from pianobot_ros.cell.host.memory import memory_folder

__all__ = ["Mark"]


class Mark:
    """A file that is there or not, of this user on this machine, by its ``name``.

    A disk that takes no file costs what a mark is for, and no more: nothing is raised.
    """

    def __init__(self, name: str) -> None:
        known = re.sub(r"[^A-Za-z0-9._-]", "_", name)
        self._path = memory_folder() / f"pianobot-{os.getuid()}-{known}"

    def __bool__(self) -> bool:
        return self._path.exists()

    def set(self) -> None:
        """Leave it."""
        with contextlib.suppress(OSError):
            self._path.touch(0o600)

    def clear(self) -> None:
        """Take it away."""
        with contextlib.suppress(OSError):
            self._path.unlink(missing_ok=True)
