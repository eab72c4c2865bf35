"""What lies in a folder of blind cases, by name."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pianobot_ros.cell.errors import ConfigError

__all__ = ["MANIFEST", "RESULTS", "read_manifest"]

MANIFEST = "manifest.json"
"""Which cases there are, and what the answers hash to."""
RESULTS = "results"
"""Folder of the diagnoses, a file for each case."""


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of a folder of cases."""
    path = folder / MANIFEST
    if not path.is_file():
        raise ConfigError(
            f"{folder} holds no blind cases ({MANIFEST} is missing): make them with `pianobot blind"
            " make`"
        )
    return dict(json.loads(path.read_text(encoding="utf-8")))
