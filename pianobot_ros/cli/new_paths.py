"""Where a command writes: looked at before anything is computed, and nothing there is replaced.

What takes a path and returns it is the callback of an option; each raises :class:`PianobotError`
where nothing new can be made there.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from pianobot_ros.cell.errors import PianobotError

__all__ = [
    "RESULT",
    "default_folder",
    "new_diagnosis",
    "new_file",
    "new_report",
    "new_result",
    "writable_folder",
]

RESULT = "result.json"
"""Of a folder of results."""


def new_file(path: Path | None) -> Path | None:
    """A file that is not there yet."""
    if path is None:
        return None
    if path.is_dir():
        raise PianobotError(f"{path} is a folder: name a file in it")
    if path.is_file():
        raise PianobotError(
            f"{path} exists already: remove it, or choose another name; nothing was overwritten"
        )
    writable_folder(path.parent)
    return path


def new_result(folder: Path | None) -> Path | None:
    """A folder without a result."""
    return _folder_without(folder, RESULT)


def new_diagnosis(folder: Path | None) -> Path | None:
    """A folder without a diagnosis."""
    return _folder_without(folder, "diagnosis.json", "report.html")


def new_report(path: Path | None) -> Path | None:
    """A file of HTML, or a folder for several."""
    if path is not None and path.suffix == ".html":
        return new_file(path)
    return _folder_without(path, "index.html")


def _folder_without(folder: Path | None, *names: str) -> Path | None:
    for there in (folder / name for name in names if folder is not None):
        if there.exists():
            raise PianobotError(
                f"{there} exists already: remove it, or choose another folder; nothing was"
                " overwritten"
            )
    return writable_folder(folder)


def writable_folder(folder: Path | None) -> Path | None:
    """A folder that is there, or can be made, and takes files."""
    if folder is None:
        return None
    there = next(p for p in (folder, *folder.parents) if p.exists())
    if not there.is_dir():
        raise PianobotError(f"{there} is a file and no folder: choose another")
    try:
        with tempfile.TemporaryFile(dir=there):  # root may all, but not in every file system
            return folder
    except OSError:
        raise PianobotError(f"{there} cannot be written to: choose another folder") from None


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
    folder = fresh_directory(Path("diagnosis") / name)
    writable_folder(folder)
    return folder
