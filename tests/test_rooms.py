"""The walls between the rooms (docs/architecture.md), checked on what each file imports."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tools"))

from house import ROOMS, circles, crowded, imported_modules  # noqa: E402

from pianobot_ros.gap.problem import constants  # noqa: E402

PACKAGE = ROOT / "pianobot_ros"
# A room within a room is told from the room around it where a wall stands between the two.
ORDER = [
    "cell",
    "cell.messages",
    "bags",
    "piano.twin",
    "piano.action",
    "piano.identify",
    "gap",
    "gap.report",
    "axis",
    "piano.gap",
    "piano.view",
]
OTHERS = ["devices", "emulator", "piano.blind", "nodes", "cli", "testing"]
ROS = (
    "rclpy",
    "pianobot_msgs",
    "std_msgs",
    "sensor_msgs",
    "geometry_msgs",
    "diagnostic_msgs",
    "std_srvs",
)


@cache
def imports(file: Path) -> tuple[str, ...]:
    """Every module and every name of a module that ``file`` imports."""
    return tuple(_imports(file))


def _imports(file: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def room_of(name: str) -> str:
    """The innermost room that a dotted name within the package lies in."""
    around = [r for r in [*ORDER, *OTHERS] if f"{name}.".startswith(f"{r}.")]
    return max(around, key=len, default=name)


def rooms_of(file: Path) -> set[str]:
    inside = (name for name in imports(file) if name.startswith("pianobot_ros."))
    return {room_of(name.partition(".")[2]) for name in inside}


def files(room: str) -> list[Path]:
    """The modules of a room, without those of rooms within it that are listed by themselves."""
    here = (f.relative_to(PACKAGE) for f in PACKAGE.joinpath(*room.split(".")).rglob("*.py"))
    found = sorted(f for f in here if room_of(".".join(f.with_suffix("").parts)) == room)
    assert found, f"room {room} is empty"
    return [PACKAGE / f for f in found]


def strangers(room: str, allowed: set[str]) -> dict[str, set[str]]:
    """By file of ``room`` the rooms that it imports from and that are not ``allowed``."""
    return {f.name: rooms_of(f) - allowed for f in files(room) if rooms_of(f) - allowed}


def test_every_module_is_in_a_room() -> None:
    modules = [f.relative_to(PACKAGE) for f in sorted(PACKAGE.rglob("*.py"))]
    rooms = {room_of(".".join(m.with_suffix("").parts)) for m in modules}
    assert rooms == {*ORDER, *OTHERS, "__init__", "piano.__init__"}


@pytest.mark.parametrize("room", [*ORDER, "piano.blind", "devices", "emulator"])
def test_pure_rooms_know_no_ros(room: str) -> None:
    guilty = [f.name for f in files(room) if any(name.split(".")[0] in ROS for name in imports(f))]
    assert not guilty


@pytest.mark.parametrize("room", ORDER)
def test_a_room_imports_only_from_its_left(room: str) -> None:
    allowed = {*ORDER[: ORDER.index(room) + 1], "__version__"}
    # The action's mechanism is built into the twin's keyboard, and both stand side by side.
    allowed |= {"piano.action"} if room == "piano.twin" else set()
    assert not strangers(room, allowed)


def test_devices_and_plant_do_not_know_the_twin() -> None:
    assert not strangers("devices", {"cell", "devices"})
    assert not strangers("emulator", {"cell", "devices", "emulator"})


def test_the_engine_and_the_axis_know_no_piano() -> None:
    assert not strangers("gap", {"gap"})
    assert not strangers("gap.report", {"gap", "gap.report"})
    assert not strangers("axis", {"gap", "gap.report", "axis"})


def test_the_engine_has_few_constants_of_its_own() -> None:
    """Beside the options: forty at most, all in one place."""
    names = [n for n in vars(constants) if n.isupper()]
    assert len(names) <= 40


def test_no_modules_import_each_other_in_a_circle() -> None:
    assert circles(imported_modules(PACKAGE)) == []


def test_no_folder_has_too_many_rooms() -> None:
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


def test_the_top_of_a_package_is_counted_without_the_engine(tmp_path: Path) -> None:
    for room in ("gap", *(f"room_{k}" for k in range(ROOMS))):
        (tmp_path / room).mkdir()
        (tmp_path / room / "module.py").touch()
    (tmp_path / "__init__.py").write_text('__version__ = "1"\n')
    assert crowded(tmp_path) == []
    (tmp_path / "script.py").touch()
    assert crowded(tmp_path) == [f"{ROOMS + 1:4} {tmp_path}"]
    (tmp_path / "__init__.py").unlink()
    assert crowded(tmp_path) == []
