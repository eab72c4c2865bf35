"""What a process leaves behind for the one that follows it, should it be killed."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import psutil

from pianobot_ros.cell.host.memory import memory_folder

__all__ = ["LEGACY", "Legacy", "Mark"]


class Mark:
    """A file that is there or not, of this user on this machine, by its ``name``; without one,
    something that this process alone knows.

    A disk that takes no file costs what outlasts the process, and no more: nothing is raised.
    """

    def __init__(self, name: str = "") -> None:
        known = re.sub(r"[^A-Za-z0-9._-]", "_", name)
        file = memory_folder() / f"pianobot-{os.getuid()}-{known}"
        self._path = file if name else None
        self._there = self._path is not None and self._path.exists()

    def __bool__(self) -> bool:
        return self._there

    def set(self, there: bool = True) -> None:
        """Leave it, or take it away."""
        if there == self._there:
            return
        self._there = there
        if self._path is not None:
            with contextlib.suppress(OSError):
                if there:
                    self._path.touch(0o600)
                else:
                    self._path.unlink(missing_ok=True)


class Legacy:
    """What a process was told since its start, by name, for the one that is started in its place
    should it die: by the same parent, with the same command.

    Known to this process alone until :meth:`inherit` and :meth:`own`. Like a mark, it costs
    what outlasts the process, and no more, where a disk takes no file.
    """

    def __init__(self) -> None:
        self._path: Path | None = None
        self._owned = False
        self._left: dict[str, Any] = {}  # by the one that died
        self._kept: dict[str, Any] = {}

    def inherit(self, command: Sequence[str]) -> None:
        """Take what a process of this command left that the same parent had started."""
        parent = psutil.Process(os.getppid())
        who = json.dumps([parent.pid, parent.create_time(), *command])
        digest = hashlib.sha256(who.encode()).hexdigest()[:16]
        self._path = memory_folder() / f"pianobot-{os.getuid()}-legacy-{digest}"
        with contextlib.suppress(OSError, ValueError, TypeError):
            self._left = dict(json.loads(_own(self._path)))
        self._kept = self._left | self._kept

    def own(self) -> None:
        """From now on leave what is kept: no other process of this command lives."""
        self._owned = True
        self._write()

    def get(self, name: str) -> Any:
        """What the one that died had kept by this name; None if nothing."""
        return self._left.get(name)

    def keep(self, name: str, value: Any) -> None:
        """Keep plain data by this name."""
        self._kept[name] = value
        self._write()

    def close(self) -> None:
        """End in order: whoever starts this command anew decides anew."""
        if self._owned and self._path is not None:
            with contextlib.suppress(OSError):
                self._path.unlink(missing_ok=True)
        self._owned, self._left, self._kept = False, {}, {}

    def _write(self) -> None:
        if not self._owned or self._path is None or not self._kept:
            return
        whole = self._path.with_name(f"{self._path.name}.{os.getpid()}")
        with contextlib.suppress(OSError):
            whole.unlink(missing_ok=True)
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW
            with os.fdopen(os.open(whole, flags, 0o600), "w", encoding="utf-8") as file:
                json.dump(self._kept, file)
            whole.replace(self._path)  # who dies amid it leaves the one before


def _own(path: Path) -> bytes:
    """The content of a file of this user's. Raises OSError for another one's: in shared memory
    anybody may lay one, or a link to one.
    """
    with os.fdopen(os.open(path, os.O_RDONLY | os.O_NOFOLLOW), "rb") as file:
        if os.fstat(file.fileno()).st_uid != os.getuid():
            raise PermissionError(f"{path} is another user's")
        return file.read()


LEGACY = Legacy()
"""That of this process."""
