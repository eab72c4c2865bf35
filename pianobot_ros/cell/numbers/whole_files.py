"""Files that are there whole or not at all, whatever the disk says on the way."""

from __future__ import annotations

import os
from pathlib import Path

from pianobot_ros.cell.errors import ConfigError

__all__ = ["write_whole"]


def write_whole(path: str | Path, text: str, folders: bool = True) -> Path:
    """Write a text file, with the ``folders`` above it; what was there stays until the new one is
    whole. Raises :class:`ConfigError` where it cannot be written, and then leaves nothing of it.
    """
    path = Path(path)
    target = path.resolve()  # a link goes on leading where it did
    part = target.with_name(f"{target.name}.{os.getpid()}.part")
    try:
        if folders:
            target.parent.mkdir(parents=True, exist_ok=True)
        if target.exists() and not target.is_file():  # /dev/stdout, a pipe: nothing to replace
            target.write_text(text, encoding="utf-8")
            return path
        try:
            part.write_text(text, encoding="utf-8")
            part.replace(target)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise ConfigError(f"cannot write {path}: {error.strerror or error}") from error
    return path
