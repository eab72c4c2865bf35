"""State files of a search, so that an interrupted one goes on where it was."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.cell.numbers.whole_files import write_whole

__all__ = ["load_state", "plain", "save_state"]


def save_state(path: str | Path, search: Mapping[str, Any], about: Mapping[str, Any]) -> Path:
    """Write the state of a search and what it is about (reference, weights); the old file stays
    whole until the new one is.
    """
    return write_whole(path, json.dumps({"about": dict(about), "search": dict(search)}, indent=1))


def load_state(path: str | Path, about: Mapping[str, Any]) -> dict[str, Any]:
    """The state of a search in a file. Raises :class:`ConfigError` if it cannot be read or belongs
    to another search.
    """
    path = Path(path)
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        before, search = dict(data["about"]), dict(data["search"])
    except FileNotFoundError as error:
        raise ConfigError(
            f"there is no state file {path}: leave out resume to start anew"
        ) from error
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{path} is not the state of a search: {error}") from error
    for name, value in about.items():
        if before.get(name) != value:
            raise ConfigError(
                f"{path} belongs to a search with {name} {before.get(name)!r}, not {value!r}: start"
                " anew"
            )
    return search


def plain(data: Any) -> Any:
    """``data`` with numbers that JSON does not know (NaN, infinity) as null."""
    if isinstance(data, Mapping):
        return {str(k): plain(v) for k, v in data.items()}
    if isinstance(data, (list, tuple)):
        return [plain(v) for v in data]
    if isinstance(data, float) and not math.isfinite(data):
        return None
    return data
