"""A recorded cell beside its twin, made without either: what the page shows is known exactly."""

from __future__ import annotations

import numpy as np

from pianobot_ros.cell.motion.geometry import keyboard
from pianobot_ros.cell.motion.strike_motion import StrikeMotion
from pianobot_ros.cell.motion.wrist_poses import wrist_pose
from pianobot_ros.cell.recordings.keystroke import NoteEvent
from pianobot_ros.cell.recordings.recording import Recording, Strike, TimeSeries

NOTE, PERIOD = 64, 1.5
DIP = 0.045  # rad


def recording(
    strikes: int = 4, *, late: float = 0.0, silent: tuple[float, float] | None = None
) -> Recording:
    """Equal strikes on the key with the sensor. ``late`` s is how much the real wrist and key come
    after the twin's; in ``silent`` s the real force board says nothing."""
    motion = StrikeMotion(0.15, 0.014, 0.25)
    starts = [0.4 + PERIOD * i for i in range(strikes)]
    pose = wrist_pose({"middle": NOTE})
    time = np.arange(0.0, 0.4 + PERIOD * strikes, 0.004)

    def height(at: np.ndarray) -> np.ndarray:
        return np.asarray(sum(motion.height(at - s) - motion.clearance for s in starts))

    def key(at: np.ndarray) -> np.ndarray:
        return np.asarray(DIP * np.clip(-height(at) - motion.clearance, 0, None) / motion.depth)

    signals, notes = {}, {}
    for cell, delay in (("real", late), ("sim", 0.0)):
        z = motion.clearance + pose.z + height(time - delay)
        place = np.column_stack([np.full_like(time, pose.x), np.full_like(time, pose.y), z])
        turn = np.tile(pose.rotation.as_rotvec(), (time.size, 1))
        angle = key(time - delay)
        there = np.ones(time.size, dtype=bool)
        if silent and cell == "real":
            there = (time < silent[0]) | (time > silent[1])
        signals |= {
            f"{cell}/wrist/state.position": TimeSeries(time, place, "m"),
            f"{cell}/wrist/state.rotation": TimeSeries(time, turn, "rad"),
            f"{cell}/vacuum/state.measured": TimeSeries(time, np.full((time.size, 3), -5e4), "Pa"),
            f"{cell}/fsr.force": TimeSeries(time[there], 60.0 * angle[there], "N"),
            f"{cell}/key_angle.{NOTE}": TimeSeries(time[there], angle[there], "rad"),
        }
        on = keyboard().midi.trigger_on
        down = np.flatnonzero(np.diff((angle > on).astype(int)))
        notes[cell] = [
            NoteEvent(float(time[i]), angle[i + 1] > on, NOTE, 60 if cell == "real" else 54)
            for i in down
        ]
    marks = [
        Strike(i, "test", "soft", "middle", NOTE, s, s + 1.2, 0.15, 0.014, 0.25, -5e4, 1.0)
        for i, s in enumerate(starts)
    ]
    return Recording(signals, notes, marks, NOTE, 1.7e9, "test")
