"""A glissando of the thumb over the octave (Fig. 8(b)): even notes, but for the first and the
last.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.motion.geometry import is_black, keyboard
from pianobot_ros.cell.motion.strike_motion import StrikeMotion
from pianobot_ros.cell.motion.wrist_poses import wrist_pose
from pianobot_ros.cell.recordings.commands import Commands
from pianobot_ros.cell.recordings.keystroke import NoteEvent
from pianobot_ros.piano.twin.experiments.single_note import DEGREE
from pianobot_ros.piano.twin.stepping.rollout import SETTLE, Run, play

__all__ = ["GlissandoRun", "glissando"]


STIFFNESS = 0.1  # N m/deg: the lowest vacuum level
DEPTH = 0.008  # m: deeper, and the thumb's flank catches on the next key
SLIDE = 2.0  # s over six keys


@dataclass(frozen=True)
class GlissandoRun:
    """The run and the white keys in the order in which they are passed."""

    run: Run
    notes: tuple[int, ...]

    @property
    def presses(self) -> list[NoteEvent]:
        """Note-on events in order."""
        return [e for e in self.run.events if e.on]

    @property
    def shifts(self) -> Array:
        """Time from each note-on to the next, s."""
        return np.diff([e.time for e in self.presses])

    @property
    def velocities(self) -> tuple[int, ...]:
        """MIDI velocities in order."""
        return tuple(e.velocity for e in self.presses)

    @property
    def holds(self) -> Array:
        """T_hold of each note, s."""
        return np.array([s.t_hold for s in self.run.strokes])


def glissando() -> GlissandoRun:
    """Press C with the thumb, slide over the seven white keys, and lift."""
    board = keyboard()
    base = wrist_pose({"thumb": board.first_note})
    motion = StrikeMotion(speed=0.05, depth=DEPTH, hold=SLIDE + 0.05)
    begin = SETTLE + motion.down_time + 0.02
    time = np.arange(0.0, SETTLE + motion.duration + 0.3, 1e-3)
    position = np.tile(base.position, (time.size, 1))
    position[:, 2] += motion.height(time - SETTLE)
    position[:, 0] += 6 * board.white.pitch * np.clip((time - begin) / SLIDE, 0.0, 1.0)
    rotation = np.tile(base.rotation.as_rotvec(), (time.size, 1))
    run = play(Commands(time, position, rotation), stiffness=STIFFNESS * DEGREE)
    return GlissandoRun(run, tuple(n for n in board.notes if not is_black(n)))
