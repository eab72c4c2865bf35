"""The Foxglove layout shows topics and fields that the graph's messages have, and every panel is
placed once.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

LAYOUT = json.loads(
    (Path(__file__).parents[2] / "docs" / "foxglove-layout.json").read_text(encoding="utf-8")
)
KINDS = {
    "wrist/state": "WristState",
    "fsr": "KeyForce",
    "key_angle": "KeyAngle",
    "vacuum/state": "VacuumState",
    "status": "TwinStatus",
    "live": "GapReport",
    "diagnosis": "Diagnosis",
}


def paths() -> list[str]:
    found = []
    for panel in LAYOUT["configById"].values():
        found += [p["value"] for p in panel.get("paths", [])]
        found += [panel["topicPath"]] if "topicPath" in panel else []
    return found


@pytest.mark.parametrize("path", paths())
def test_every_path_names_a_field(path: str) -> None:
    msg = pytest.importorskip("pianobot_msgs.msg")
    topic, *fields = path.split(".")
    match = re.fullmatch(r"/(?:real|sim|gap)/(.+)", topic)
    assert match and match[1] in KINDS, path
    message: Any = getattr(msg, KINDS[match[1]])()
    for field in fields:
        name = field.partition("[")[0]
        kind = message.get_fields_and_field_types()[name]
        assert kind.startswith("sequence<") == ("[" in field), f"{name} in {path} is {kind}"
        inner = re.sub(r"sequence<(.*?)(, \d+)?>", r"\1", kind)
        message = (
            getattr(msg, inner.partition("/")[2])()
            if inner.startswith("pianobot_msgs/")
            else getattr(message, name)
        )


def test_every_panel_is_placed_once() -> None:
    placed: list[str] = []

    def walk(part: Any) -> None:
        if isinstance(part, str):
            placed.append(part)
        else:
            walk(part["first"])
            walk(part["second"])

    walk(LAYOUT["layout"])
    assert sorted(placed) == sorted(LAYOUT["configById"])
