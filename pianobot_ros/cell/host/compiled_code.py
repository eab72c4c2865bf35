"""Compiled code that numba keeps beside the sources: forgotten when any source of a folder
changes.
"""

from __future__ import annotations

import contextlib
import hashlib
from pathlib import Path

__all__ = ["forget_stale_code"]


def forget_stale_code(folder: Path) -> None:
    """Delete the compiled code under ``folder`` if any of its sources has changed since it was last
    called.

    Numba notices a change only in the file of the function itself, not in those that it has inlined
    from other files.
    """
    sources = sorted(folder.rglob("*.py"))
    mark = hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()
    stamp = folder / "__pycache__" / "sources.sha256"
    with contextlib.suppress(OSError):  # installed read-only: then the sources do not change either
        if stamp.is_file() and stamp.read_text() == mark:
            return
        stamp.parent.mkdir(exist_ok=True)
        for cache in folder.rglob("__pycache__"):
            for path in (*cache.glob("*.nbi"), *cache.glob("*.nbc")):
                path.unlink(missing_ok=True)
        stamp.write_text(mark)
