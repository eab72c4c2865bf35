"""Two notes in one stretch (Fig. 8(c)): E with the thumb and G sharp with the middle finger, slowly and then fast."""

from __future__ import annotations

from dataclasses import dataclass

from pianobot_ros.cell.geometry import keyboard
from pianobot_ros.cell.keystroke import Keystroke
from pianobot_ros.cell.motion import StrikeMotion
from pianobot_ros.twin.experiments.single_note import DEGREE
from pianobot_ros.twin.rollout import Run, play, strike_commands

__all__ = ["G_SHARP", "E", "TwoNotes", "two_notes"]

E, G_SHARP = 64, 68
STIFFNESS = 0.3  # N m/deg: the middle of the vacuum's range
SLOW = StrikeMotion(speed=0.04, depth=0.010, hold=0.05)
FAST = StrikeMotion(speed=0.16, depth=0.010, hold=0.05)


@dataclass(frozen=True)
class TwoNotes:
    """The slow and the fast run."""

    slow: Run
    fast: Run

    def stroke(self, run: Run, note: int) -> Keystroke:
        """The keystroke of a note."""
        return next(s for s in run.strokes if s.note == note)

    def bedded(self, run: Run, note: int) -> bool:
        """Whether the key reached its bed."""
        return bool(run.key(note)[0].max() >= keyboard().mechanism.max_angle)


def two_notes() -> TwoNotes:
    """Press both notes in one motion of the wrist, at two speeds."""
    targets = {"thumb": E, "middle": G_SHARP}
    return TwoNotes(
        play(strike_commands(targets, SLOW), stiffness=STIFFNESS * DEGREE),
        play(strike_commands(targets, FAST), stiffness=STIFFNESS * DEGREE),
    )
