"""What a process leaves behind for the one that follows it, should it be killed."""

from __future__ import annotations

import contextlib
import os
import re
import tempfile
from pathlib import Path

__all__ = ["Mark"]

_MEMORY = Path("/dev/shm")  # forgotten when the machine starts anew


class Mark:
    """A file that is there or not, of this user on this machine, by its ``name``.

    A disk that takes no file costs what a mark is for, and no more: nothing is raised.
    """

    def __init__(self, name: str) -> None:
        folder = _MEMORY if _MEMORY.is_dir() else Path(tempfile.gettempdir())
        self._path = folder / f"pianobot-{os.getuid()}-{re.sub(r'[^A-Za-z0-9._-]', '_', name)}"

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
