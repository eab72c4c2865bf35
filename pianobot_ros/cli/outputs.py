"""Where a command writes: looked at before anything is computed, and nothing there is replaced."""

from __future__ import annotations

import os
from pathlib import Path

from pianobot_ros.cell.errors import PianobotError

__all__ = ["default_folder", "new_file", "new_results"]


def new_file(path: Path | None) -> None:
    """Raise :class:`PianobotError` unless a file can be made at ``path``, if one is wanted."""
    if path is None:
        return
    if path.is_dir():
        raise PianobotError(f"{path} is a folder: name a file in it")
    if path.is_file():
        raise PianobotError(
            f"{path} exists already: remove it, or choose another name; nothing was overwritten"
        )
    _room(path.parent)


def new_results(folder: Path | None, *names: str) -> None:
    """Raise :class:`PianobotError` unless files of these names can be made in ``folder``, if one is
    wanted.
    """
    if folder is None:
        return
    _room(folder)
    for name in names:
        if (folder / name).exists():
            raise PianobotError(
                f"{folder / name} exists already: remove it, or choose another folder; nothing was"
                " overwritten"
            )


def _room(folder: Path) -> None:
    """Raise :class:`PianobotError` unless a folder is there, or can be made, and written to."""
    there = next(p for p in (folder, *folder.parents) if p.exists())
    if not there.is_dir():
        raise PianobotError(f"{there} is a file and no folder: choose another")
    if not os.access(there, os.W_OK | os.X_OK):
        raise PianobotError(f"{there} cannot be written to: choose another folder")


def default_folder(bag: Path) -> Path:
    """``diagnosis/NAME`` of a bag, or the first free ``diagnosis/NAME-2`` and so on. A bag that has
    its name of the run that it lies in (``bag``, ``bag-2``) is called as the run is.
    """
    from pianobot_ros.bags.live_writer import fresh_directory

    whole = bag.resolve()
    if whole.name.startswith(f"{whole.parent.name}_"):  # the .mcap file in a bag
        whole = whole.parent
    name = whole.name
    if name.split("-")[0] == "bag" and whole.parent.name:
        name = whole.parent.name + name.removeprefix("bag").replace("-", "-bag-", 1)
    return fresh_directory(Path("diagnosis") / name)
