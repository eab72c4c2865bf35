"""Two notes in one stretch (Fig. 8(c)): E with the thumb and G sharp with the middle finger, each
struck twice in one run, the second time by a swifter wrist.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pianobot_ros.cell.motion.geometry import keyboard
from pianobot_ros.cell.motion.strike_motion import StrikeMotion
from pianobot_ros.cell.recordings.commands import Commands
from pianobot_ros.cell.recordings.keystroke import Keystroke
from pianobot_ros.piano.twin.experiments.single_note import DEGREE
from pianobot_ros.piano.twin.stepping.rollout import Run, play, strike_commands

__all__ = ["CASES", "G_SHARP", "E", "Margins", "TwoNotes", "margins", "staccato", "two_notes"]

E, G_SHARP = 64, 68
TARGETS = {"thumb": E, "middle": G_SHARP}
STIFFNESS = 0.3  # N m/deg: the middle of the vacuum's range
SPEEDS = (0.04, 0.16)  # m/s: slow, then swift
DEPTH, HOLD = 0.009, 0.05  # m, s: between E on its bed (10 mm) and E silent
CASES = (  # depth m, stiffness N m/deg, around what is shown
    (DEPTH, STIFFNESS),
    (DEPTH - 0.0005, STIFFNESS),
    (DEPTH + 0.0005, STIFFNESS),
    (DEPTH, STIFFNESS / 1.5),
    (DEPTH, STIFFNESS * 1.5),
)


@dataclass(frozen=True)
class TwoNotes:
    """One run; ``parted`` s is where the second strikes begin."""

    run: Run
    parted: float

    def strokes(self, note: int) -> tuple[Keystroke, Keystroke]:
        """The slow and the swift keystroke of a note."""
        slow, swift = [s for s in self.run.strokes if s.note == note]
        return slow, swift

    def deepest(self, note: int) -> tuple[float, float]:
        """Largest key angle (rad) of the slow and of the swift strike."""
        first = self.run.time < self.parted
        angle = self.run.key(note)[0]
        return float(angle[first].max()), float(angle[~first].max())


@dataclass(frozen=True)
class Margins:
    """Of a ``depth`` (m) and ``stiffness`` (N m/deg): by how much (rad) E stays short of its bed
    and G sharp is pressed into it, each at the worse of both strikes; whether all four ``sounded``.
    """

    depth: float
    stiffness: float
    short: float
    pressed: float
    sounded: bool


def staccato(depth: float = DEPTH) -> tuple[Commands, float]:
    """Both notes slowly and then swiftly in one motion of the wrist, and where (s) the second
    strikes begin.
    """
    slow, swift = (strike_commands(TARGETS, StrikeMotion(v, depth, HOLD)) for v in SPEEDS)
    shift = float(slow.duration)
    whole = replace(
        slow,
        time=np.concatenate([slow.time, shift + swift.time]),
        position=np.concatenate([slow.position, swift.position]),
        rotation=np.concatenate([slow.rotation, swift.rotation]),
    )
    return whole, shift


def two_notes(depth: float = DEPTH, stiffness: float = STIFFNESS) -> TwoNotes:
    """Press both notes twice, ``depth`` m below their tops with joints of ``stiffness`` N m/deg."""
    commands, parted = staccato(depth)
    return TwoNotes(play(commands, stiffness=stiffness * DEGREE), parted)


def margins(cases: Sequence[tuple[float, float]] = CASES) -> list[Margins]:
    """How near each of ``cases`` (depth m, stiffness N m/deg) is to another pattern."""
    bed = keyboard().mechanism.max_angle
    found = []
    for depth, stiffness in cases:
        two = two_notes(depth, stiffness)
        short = bed - max(two.deepest(E))
        pressed = min(two.deepest(G_SHARP)) - bed
        found.append(Margins(depth, stiffness, short, pressed, len(two.run.strokes) == 4))
    return found
