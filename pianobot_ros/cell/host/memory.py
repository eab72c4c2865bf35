"""Where small files go that nobody needs once the machine starts anew."""

from __future__ import annotations

import os
from pathlib import Path

__all__ = ["memory_folder", "writable"]

_MEMORY = Path("/dev/shm")


def memory_folder() -> Path:
    """The machine's shared memory; where this user may not write there, as in some containers, the
    folder of temporary files.
    """
    if writable(_MEMORY):
        return _MEMORY
    import tempfile

    return Path(tempfile.gettempdir())


def writable(folder: Path) -> bool:
    """Whether this process may make files in a folder, or make the folder if there is none yet."""
    there = next((place for place in (folder, *folder.absolute().parents) if place.exists()), None)
    return there is not None and there.is_dir() and os.access(there, os.W_OK | os.X_OK)
