"""Which code this is, for whoever reads its results later."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from subprocess import DEVNULL, PIPE, SubprocessError, run

from pianobot_ros import __version__

__all__ = ["code_version"]


@cache
def code_version() -> dict[str, str]:
    """``version``, and ``commit`` (with a ``+`` if files were changed since) in a checkout."""
    root = Path(__file__).resolve().parents[2]
    found = {"version": __version__}
    if not (root / ".git").exists():
        return found
    try:
        head = run(
            ["git", "-C", str(root), "describe", "--always", "--dirty=+", "--exclude=*"],
            check=True,
            stdout=PIPE,
            stderr=DEVNULL,
            text=True,
            timeout=5.0,
        )
    except (OSError, SubprocessError):
        return found
    return found | {"commit": head.stdout.strip()}
