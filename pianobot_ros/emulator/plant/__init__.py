"""The plant behind the emulated devices: a second implementation of the cell, apart from the twin,
with effects to inject.
"""

from __future__ import annotations

import contextlib
import hashlib
from pathlib import Path


def _forget_stale_code() -> None:
    """Delete the compiled code that numba keeps if any source of the compiled rooms has changed.

    Numba notices a change only in the file of the function itself, not in those that it has inlined
    from other files.
    """
    here = Path(__file__).resolve().parent
    sources = sorted(here.rglob("*.py"))
    mark = hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()
    stamp = here / "__pycache__" / "sources.sha256"
    with contextlib.suppress(OSError):  # installed read-only: then the sources do not change either
        if stamp.is_file() and stamp.read_text() == mark:
            return
        stamp.parent.mkdir(exist_ok=True)
        for cache in here.rglob("__pycache__"):
            for path in (*cache.glob("*.nbi"), *cache.glob("*.nbc")):
                path.unlink(missing_ok=True)
        stamp.write_text(mark)


_forget_stale_code()
