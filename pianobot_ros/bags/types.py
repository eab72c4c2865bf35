"""Message types for bag files: the standard ones, and ours from the interface package's own definitions."""

from __future__ import annotations

import os
import sys
from functools import lru_cache
from pathlib import Path

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from pianobot_ros.cell.errors import ConfigError

__all__ = ["definitions_dir", "new_typestore", "typestore"]


def definitions_dir() -> Path:
    """Directory with the ``.msg`` files of pianobot_msgs: the source tree's, else the installed ones."""
    source = Path(__file__).resolve().parents[2] / "msg_schemas" / "msg"
    prefixes = [Path(p) for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p] + [Path(sys.prefix)]
    for path in [source, *(p / "share" / "pianobot_msgs" / "msg" for p in prefixes)]:
        if path.is_dir():
            return path
    raise ConfigError("the definitions of pianobot_msgs are not installed: run `make` in the project's directory")


def new_typestore() -> Typestore:
    """A fresh store with the Jazzy types and pianobot_msgs, to which the definitions inside a bag may be added."""
    store = get_typestore(Stores.ROS2_JAZZY)
    ours = {}
    for file in sorted(definitions_dir().glob("*.msg")):
        ours.update(get_types_from_msg(file.read_text(encoding="utf-8"), f"pianobot_msgs/msg/{file.stem}"))
    store.register(ours)
    return store


@lru_cache(maxsize=1)
def typestore() -> Typestore:
    """The shared store for writing. Do not register anything in it."""
    return new_typestore()
