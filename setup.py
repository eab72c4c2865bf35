"""What pip and colcon need beyond pyproject.toml: the files of an ament package under share/ and
lib/.
"""

import sys
from pathlib import Path

from setuptools import setup

NODES = sorted(
    p.stem
    for p in Path("pianobot_ros/nodes").rglob("*.py")
    if "\ndef main(" in p.read_text(encoding="utf-8")
)
SHARE = "share/pianobot_ros"


def tree(folder):
    """(target, files) pairs for the files of a folder and its subfolders."""
    folders = [
        Path(folder),
        *(p for p in Path(folder).rglob("*") if p.is_dir() and p.name != "__pycache__"),
    ]
    return [(f"{SHARE}/{d}", [str(f) for f in d.iterdir() if f.is_file()]) for d in folders]


def launchers():
    """Shell scripts lib/pianobot_ros/<node>, where `ros2 run` looks. colcon puts the entry points
    there by itself.
    """
    if "install" in sys.argv or "develop" in sys.argv:
        return []
    folder = Path("build/launchers")
    folder.mkdir(parents=True, exist_ok=True)
    for name in NODES:
        (folder / name).write_text(
            f'#!/bin/sh\nexec "$(dirname "$0")/../../bin/{name}" "$@"\n', encoding="utf-8"
        )
        (folder / name).chmod(0o755)
    return [("lib/pianobot_ros", [str(folder / name) for name in NODES])]


setup(
    python_requires=">=3.10",
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/pianobot_ros"]),
        (SHARE, ["package.xml"]),
        *tree("config"),
        *tree("launch"),
        *launchers(),
    ],
)
