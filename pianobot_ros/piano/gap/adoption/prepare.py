"""What the running twin computes with, compiled before a phrase needs it."""

from __future__ import annotations

import numpy as np

from pianobot_ros.cell.motion.wrist_poses import wrist_pose
from pianobot_ros.piano.gap.adoption.live_laws import LiveLaws, parse_effects
from pianobot_ros.piano.gap.effects import LIBRARY
from pianobot_ros.piano.twin.stepping.cell_twin import CellTwin
from pianobot_ros.piano.twin.stepping.rollout import reduced

__all__ = ["prepare_laws"]


def prepare_laws() -> None:
    """Compile every law: what no cache holds yet takes many seconds, which no phrase has."""
    starts = [f"{name}.{n}={x!r}" for name, f in LIBRARY.items() for n, x in f.starts[-1].items()]
    pose = wrist_pose({"middle": 64})
    home = np.array([pose.x, pose.y, pose.z, *pose.rotation.as_rotvec()])
    twin = CellTwin(reduced("middle", 64), home, LiveLaws(parse_effects(starts)))
    twin.step(20)
