"""One whole cell at a time on a machine: two that play at once make each other late."""

from __future__ import annotations

import fcntl
import os
import tempfile
from pathlib import Path

from pianobot_ros.cell.host.closing import Closing

__all__ = ["Alone"]


class Alone(Closing):
    """Waits until no other test of this user plays on a whole cell, and keeps others waiting until
    it is closed. The lock goes with the process, however that ends.
    """

    def __init__(self) -> None:
        path = Path(tempfile.gettempdir()) / f"pianobot-cell-{os.getuid()}.lock"
        self._file = path.open("w")
        fcntl.flock(self._file, fcntl.LOCK_EX)

    def close(self) -> None:
        """Let the next one in. Safe to call twice."""
        self._file.close()
