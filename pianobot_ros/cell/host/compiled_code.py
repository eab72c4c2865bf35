"""Compiled code that numba keeps beside the sources: forgotten when any source of a folder
changes, and kept elsewhere by who may not write there.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Mapping
from pathlib import Path

from pianobot_ros.cell.host.memory import writable

__all__ = ["folder_of_compiled_code", "forget_stale_code"]

KEPT_IN = "NUMBA_CACHE_DIR"
"""Name of numba's own environment variable for a folder of compiled code."""


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


def folder_of_compiled_code(package: Path) -> Mapping[str, str]:
    """Environment with which numba finds a folder, where it finds none by itself and would end the
    program: neither beside the sources of ``package`` nor in the user's home may it write.
    """
    home = os.environ.get("XDG_CACHE_HOME") or os.environ.get("HOME")
    if KEPT_IN in os.environ or writable(package) or (home and writable(Path(home) / ".cache")):
        return {}
    import tempfile

    # Of these sources: numba would not notice that another version has taken their place.
    version = f"{package} {(package / '__init__.py').stat().st_mtime_ns}"
    mark = hashlib.sha256(version.encode()).hexdigest()[:12]
    with contextlib.suppress(OSError):
        folder = Path(tempfile.gettempdir()) / f"pianobot-{os.getuid()}-compiled-{mark}"
        folder.mkdir(0o700, exist_ok=True)
        told = folder.lstat()
        # Numba runs what lies there: it must be nobody else's.
        if told.st_uid != os.getuid() or told.st_mode & 0o022 or folder.is_symlink():
            folder = Path(tempfile.mkdtemp(prefix="pianobot-compiled-"))
        return {KEPT_IN: str(folder)}
    return {}
