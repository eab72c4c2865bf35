"""The walls between the rooms (docs/architecture.md), checked on what each file imports."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tools"))

from house import ROOMS, circles, crowded, imported_modules  # noqa: E402

PACKAGE = ROOT / "pianobot_ros"
ORDER = [
    "cell",
    "messages",
    "bags",
    "twin",
    "action",
    "identify",
    "gap",
    "report",
    "axis",
    "piano_twin",
    "view",
]
ROS = (
    "rclpy",
    "pianobot_msgs",
    "std_msgs",
    "sensor_msgs",
    "geometry_msgs",
    "diagnostic_msgs",
    "std_srvs",
)


def imports(file: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            yield node.module


def rooms_of(file: Path) -> set[str]:
    return {name.split(".")[1] for name in imports(file) if name.startswith("pianobot_ros.")}


def files(room: str) -> list[Path]:
    found = sorted((PACKAGE / room).rglob("*.py"))
    assert found, f"room {room} is empty"
    return found


@pytest.mark.parametrize("room", [*ORDER, "devices", "emulator"])
def test_pure_rooms_know_no_ros(room: str) -> None:
    guilty = [f.name for f in files(room) if any(name.split(".")[0] in ROS for name in imports(f))]
    assert not guilty


@pytest.mark.parametrize("room", ORDER)
def test_a_room_imports_only_from_its_left(room: str) -> None:
    allowed = {*ORDER[: ORDER.index(room) + 1], "__version__"}
    # The action's mechanism is built into the twin's keyboard, and both stand side by side.
    allowed |= {"action"} if room == "twin" else set()
    wrong = {f.name: rooms_of(f) - allowed for f in files(room) if rooms_of(f) - allowed}
    assert not wrong


@pytest.mark.parametrize("room", ["emulator", "devices"])
def test_devices_and_plant_do_not_know_the_twin(room: str) -> None:
    for file in files(room):
        assert not rooms_of(file) & {
            "twin",
            "action",
            "gap",
            "piano_twin",
            "identify",
            "report",
            "nodes",
        }, file.name


def test_the_engine_knows_no_piano() -> None:
    for file in files("gap"):
        names = {name for name in imports(file) if name.startswith("pianobot_ros.")}
        assert all(n.startswith("pianobot_ros.gap") for n in names), file.name


def test_no_modules_import_each_other_in_a_circle() -> None:
    assert circles(imported_modules(PACKAGE)) == []


def test_no_folder_below_the_top_level_has_too_many_rooms() -> None:
    assert crowded(PACKAGE) == []


def test_circles_and_crowded_folders_are_found(tmp_path: Path) -> None:
    folder = tmp_path / "house" / "floor"
    folder.mkdir(parents=True)
    for k in range(ROOMS):
        (folder / f"room_{k}.py").touch()
    face = folder / "__init__.py"
    face.write_text('"""A face."""\n\nfrom house.floor.room_0 import x\n\n__all__ = ["x"]\n')
    (folder / "room_0.py").write_text("from house.floor import room_1\n")
    (folder / "room_1.py").write_text("def f():\n    from house.floor.room_2 import y\n")
    assert crowded(tmp_path / "house") == []
    assert circles(imported_modules(tmp_path / "house")) == []
    (folder / "room_2.py").write_text("import house.floor.room_0\n")
    found = circles(imported_modules(tmp_path / "house"))
    assert found == [[f"house.floor.room_{k}" for k in range(3)]]
    face.write_text("def x(): ...\n")
    assert crowded(tmp_path / "house") == [f"{ROOMS + 1:4} {folder}"]
