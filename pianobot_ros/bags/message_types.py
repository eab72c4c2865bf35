"""Message types for bag files: the standard ones, and ours from the interface package's own
definitions; and how a bag describes a type, as rosbag2 does.
"""

from __future__ import annotations

import os
import sys
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from rosbags.interfaces import Nodetype
from rosbags.typesys import (
    Stores,
    TypesysError,
    get_types_from_idl,
    get_types_from_msg,
    get_typestore,
)
from rosbags.typesys.store import Typestore

from pianobot_ros.cell.errors import ConfigError, RecordingError

__all__ = ["Schema", "definitions_dir", "new_typestore", "schema_of", "type_hash", "typestore"]

_RULE = "=" * 80 + "\n"  # between the definitions of a schema


class Schema(NamedTuple):
    """How a bag describes a type: ``text`` with the definitions of all nested types, ``encoding``
    "ros2msg" or "ros2idl", and ``digest``, the type's RIHS01 hash ("" if the text cannot be read).
    """

    text: str
    encoding: str
    digest: str


def definitions_dir() -> Path:
    """Directory with the ``.msg`` files of pianobot_msgs: the source tree's, else the installed
    ones.
    """
    source = Path(__file__).resolve().parents[2] / "msg_schemas" / "msg"
    for path in [source, *(p / "share" / "pianobot_msgs" / "msg" for p in _prefixes())]:
        if path.is_dir():
            return path
    raise ConfigError(
        "the definitions of pianobot_msgs are not installed: run `make` in the project's directory"
    )


def _prefixes() -> list[Path]:
    """Where ROS packages are installed."""
    listed = [Path(p) for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    return [*listed, Path(sys.prefix)]


def new_typestore() -> Typestore:
    """A fresh store with the Jazzy types and pianobot_msgs, to which the definitions inside a bag
    may be added.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    ours = {}
    for file in sorted(definitions_dir().glob("*.msg")):
        ours.update(
            get_types_from_msg(file.read_text(encoding="utf-8"), f"pianobot_msgs/msg/{file.stem}")
        )
    store.register(ours)
    return store


@lru_cache(maxsize=1)
def typestore() -> Typestore:
    """The shared store for writing. Do not register anything in it."""
    return new_typestore()


@lru_cache(maxsize=256)
def schema_of(kind: str) -> Schema:
    """The schema of a type ``package/msg/Name`` that is installed or known.

    The text is that of the ``.msg`` files, with their comments, as rosbag2 stores it. Raises
    :class:`RecordingError` for a type that nothing here defines.
    """
    try:
        text = _installed_text(kind) or typestore().generate_msgdef(kind, ros_version=2)[0]
    except (TypesysError, KeyError) as error:
        raise RecordingError(f"the type {kind} is not known: install its package") from error
    return Schema(text, "ros2msg", type_hash(kind, text, "ros2msg"))


@lru_cache(maxsize=64)
def type_hash(kind: str, text: str, encoding: str) -> str:
    """RIHS01 hash of a type by a schema's text; "" if the text does not define it."""
    try:
        store = get_typestore(Stores.EMPTY)
        if encoding == "ros2idl":
            parts = text.split(_RULE)[1:] or ["\n" + text]
            for part in parts:
                store.register(get_types_from_idl(part.split("\n", 1)[1]))
        else:
            store.register(get_types_from_msg(text, kind))
        return str(store.hash_rihs01(kind))
    except (TypesysError, KeyError, ValueError, IndexError, SyntaxError):
        return ""  # SyntaxError: the store writes Python from the names that a damaged text has


def _installed_text(kind: str) -> str:
    """The ``.msg`` files of a type and of all types in it; "" if one of them is not installed."""
    texts: dict[str, str] = {}
    pending = [kind]
    while pending:
        name = pending.pop(0)
        if name in texts:
            continue
        if (file := _file(name)) is None:
            return ""
        texts[name] = file.read_text(encoding="utf-8")
        pending += _nested(get_types_from_msg(texts[name], name)[name])
    own = texts.pop(kind)
    return own + "".join(
        f"\n{_RULE}MSG: {name.replace('/msg/', '/')}\n{text}" for name, text in texts.items()
    )


def _file(kind: str) -> Path | None:
    package, _, name = kind.partition("/msg/")
    if package == "pianobot_msgs":
        file = definitions_dir() / f"{name}.msg"
        return file if file.is_file() else None
    files = (p / "share" / package / "msg" / f"{name}.msg" for p in _prefixes())
    return next((file for file in files if file.is_file()), None)


def _nested(definition: Any) -> list[str]:
    """The types of a message's fields that are messages themselves."""
    names = []
    for _, described in definition[1]:
        node, what = described
        if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            node, what = what[0]
        if node == Nodetype.NAME:
            names.append(what)
    return names
