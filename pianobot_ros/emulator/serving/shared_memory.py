"""Memory that several processes map, with one writer for each value.

A value is guarded by a sequence lock: the writer makes the sequence odd, writes, makes it even; a
reader takes a copy and reads again if the sequence was odd or has changed. A ring has one writer,
who raises its head after the row is complete; a reader who was lapped is told how many rows it
lost.
"""

from __future__ import annotations

import contextlib
import errno
import mmap
import os
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import DeviceError
from pianobot_ros.cell.host.closing import Closing

__all__ = ["BusError", "SharedMemory"]


class BusError(DeviceError):
    """The shared memory of the emulated cell is missing, not ready, or from another version."""


class SharedMemory(Closing):
    """A file of one record of ``layout``, mapped; made anew if ``create``.

    A guarded value NAME is a row (time, value …) beside its NAME_sequence; a ring NAMEs has rows
    beside its NAME_head.
    """

    def __init__(self, path: Path, layout: np.dtype[Any], *, create: bool) -> None:
        self.path = path
        flags = os.O_RDWR | (os.O_CREAT | os.O_TRUNC if create else 0)
        try:
            descriptor = os.open(path, flags, 0o600)
        except OSError as error:
            raise BusError(
                _cannot(path, error)
                if create
                else f"no emulated cell at {path} ({error.strerror}): start `python -m"
                " pianobot_ros.emulator`"
            ) from error
        try:
            if create:
                _take_room(path, descriptor, layout.itemsize)
            elif os.fstat(descriptor).st_size != layout.itemsize:
                raise BusError(
                    f"{path} is not the shared memory of this version of the emulated cell: start"
                    " the cell anew"
                )
            self._map = mmap.mmap(descriptor, layout.itemsize)
        finally:
            os.close(descriptor)
        self._data: Any = np.frombuffer(self._map, dtype=layout, count=1)
        self._view = {name: self._data[name] for name in layout.names or ()}
        self._seen: dict[str, tuple[int, float, Array]] = {}
        self._created = create

    def _write(self, name: str, t: float, value: ArrayLike) -> None:
        sequence, block = self._view[f"{name}_sequence"], self._view[name]
        start = int(sequence[0])
        sequence[0] = start + 1
        block[0, 0] = t
        block[0, 1:] = value
        sequence[0] = start + 2

    def _read(self, name: str) -> tuple[float, Array]:
        """Time and values (n,) last written, not to be changed: who asks again before they are
        written anew gets the same.
        """
        sequence, block = self._view[f"{name}_sequence"], self._view[name]
        while True:
            before = int(sequence[0])
            last = self._seen.get(name)
            if last is not None and last[0] == before:
                return last[1], last[2]
            copy = block[0].copy()
            if before % 2 == 0 and int(sequence[0]) == before:
                self._seen[name] = before, float(copy[0]), copy[1:]
                return float(copy[0]), copy[1:]
            time.sleep(0)

    def _head(self, ring: str) -> int:
        """How many rows were ever written to a ring."""
        return int(self._view[f"{ring}_head"][0])

    def _append(self, ring: str, rows: ArrayLike) -> None:
        """Add a row (width,) or rows (n, width)."""
        kept, heads = self._view[f"{ring}s"][0], self._view[f"{ring}_head"]
        head, size = int(heads[0]), len(kept)
        for row in rows if np.ndim(rows) > 1 else (rows,):  # type: ignore[union-attr]
            kept[head % size] = row
            head += 1
            heads[0] = head

    def _rows(self, ring: str, since: int | None) -> tuple[int, int, Array]:
        """How many rows were lost, the end index, and the rows of a ring from ``since`` on (None:
        only those to come); half the ring is kept as margin against the writer.
        """
        kept = self._view[f"{ring}s"][0]
        size = len(kept)
        since = self._head(ring) if since is None else since
        while True:
            head = self._head(ring)
            first = max(since, head - size // 2)
            begin = first % size
            end = begin + max(head - first, 0)
            rows = kept[begin:end].copy()
            if end > size:
                rows = np.concatenate([rows, kept[: end - size]])
            if self._head(ring) - first < size:
                return first - since, head, rows

    def close(self) -> None:
        """Let go of the memory; the creator also removes the file."""
        if self._map.closed:
            return
        self._view.clear()
        self._data = None
        with contextlib.suppress(BufferError):  # someone still holds an array that points here
            self._map.close()
        if self._created:
            with contextlib.suppress(FileNotFoundError):
                self.path.unlink()


def _take_room(path: Path, descriptor: int, size: int) -> None:
    """Give a file its size and the memory for it: whoever writes to a page for which a full memory
    file system has none left is killed (SIGBUS).
    """
    try:
        os.ftruncate(descriptor, size)
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(descriptor, 0, size)
    except OSError as error:
        if error.errno in (errno.ENOSYS, errno.EOPNOTSUPP):  # a file system without such promises
            return
        path.unlink(missing_ok=True)
        raise BusError(_cannot(path, error)) from error


def _cannot(path: Path, error: OSError) -> str:
    return (
        f"the emulated cell cannot have its shared memory at {path} ({error.strerror}): make room"
        f" in {path.parent}, or let this user write there"
    )
