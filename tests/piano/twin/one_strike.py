"""One strike as the reduced model gets it."""

from __future__ import annotations

import numpy as np

from pianobot_ros.cell.motion.strike_motion import StrikeMotion
from pianobot_ros.cell.motion.wrist_poses import wrist_pose
from pianobot_ros.piano.twin.reduced.strike_model import StrikeInput, StrikeModel, strike_model


def given(
    finger: str = "middle",
    note: int = 64,
    speed: float = 0.15,
    depth: float = 0.014,
    hold: float = 0.25,
    pressure: float = -50e3,
) -> tuple[StrikeModel, StrikeInput]:
    pose = wrist_pose({finger: note})
    model = strike_model(finger, note)
    motion = StrikeMotion(speed, depth, hold)
    t = np.arange(-0.1, motion.duration + 0.2, 0.002)
    wrist = np.tile(pose.position, (len(t), 1))
    wrist[:, 2] += motion.height(t)
    return model, model.input(
        t, wrist, pose.rotation.as_rotvec(), pressure, -0.05, motion.duration + 0.15
    )
