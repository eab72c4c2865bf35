"""What holds something that must be given back: one way to use it in a ``with`` statement."""

from __future__ import annotations

import subprocess
from typing import Any, TypeVar

__all__ = ["Closing", "wait_or_kill"]

_Self = TypeVar("_Self", bound="Closing")


class Closing:
    """A context manager whose end is ``close()``, however the block was left."""

    def close(self) -> None:
        """Give back what is held. Safe to call twice."""
        raise NotImplementedError

    def __enter__(self: _Self) -> _Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def wait_or_kill(process: subprocess.Popen[Any], limit: float) -> None:
    """Wait until a process that was asked to end has ended; kill it after ``limit`` s."""
    try:
        process.wait(limit)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
