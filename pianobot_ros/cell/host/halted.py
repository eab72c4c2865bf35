"""What the kernel says of other processes."""

from __future__ import annotations

from pathlib import Path

__all__ = ["SUPERVISOR", "halted"]

SUPERVISOR = "PIANOBOT_SUPERVISOR"
"""Name of the environment variable by which a supervisor tells its nodes its process id."""


def halted(pid: int) -> bool:
    """Whether a signal has stopped the process (a debugger's stop does not count)."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False
    return fields.rpartition(")")[2].split()[:1] == ["T"]
