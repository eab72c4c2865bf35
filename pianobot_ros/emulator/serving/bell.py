"""How one process of the cell wakes another one that waits for it in ``select``."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from pianobot_ros.cell.host.closing import Closing

__all__ = ["Bell"]


class Bell(Closing):
    """A named pipe at ``path``, made anew if ``create``, and then removed in the end.

    Raises OSError if there is none.
    """

    def __init__(self, path: Path, *, create: bool) -> None:
        self._path, self._created = path, create
        if create:
            path.unlink(missing_ok=True)
            os.mkfifo(path, 0o600)
        # Open at both ends, so that neither side needs the other to be there.
        self._pipe = os.open(path, os.O_RDWR | os.O_NONBLOCK)

    def fileno(self) -> int:
        """Descriptor for ``select``."""
        return self._pipe

    def ring(self) -> None:
        """Wake who waits; one who has not listened for long has enough to hear."""
        with contextlib.suppress(BlockingIOError):
            os.write(self._pipe, b"!")

    def heard(self) -> None:
        """Forget that it rang."""
        with contextlib.suppress(BlockingIOError):
            os.read(self._pipe, 4096)

    def close(self) -> None:
        """Let go of the pipe; the creator also removes it."""
        if self._pipe < 0:
            return
        os.close(self._pipe)
        self._pipe = -1
        if self._created:
            self._path.unlink(missing_ok=True)
