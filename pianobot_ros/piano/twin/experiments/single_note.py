"""One note with joints from soft to stiff (Figs. 7 and 8(a)): the key moves alike, the force rises,
and bulges at the key bed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.motion.geometry import keyboard
from pianobot_ros.cell.motion.strike_motion import StrikeMotion
from pianobot_ros.piano.twin.stepping.rollout import (
    BatchJob,
    Run,
    play_batch,
    reduced,
    strike_commands,
)

__all__ = ["DEGREE", "STIFFNESSES", "SingleNote", "single_note"]


DEGREE = 180.0 / np.pi
"""N m/rad in 1 N m/deg."""

STIFFNESSES = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
"""N m/deg; the ends are the paper's."""

NOTE = 64
MOTION = StrikeMotion(speed=0.03, depth=0.015, hold=0.6)
"""Slow, and deep enough for the softest finger to reach the key bed: about as long as Fig. 8(a).
The paper gives no figures.
"""


@dataclass(frozen=True)
class SingleNote:
    """Runs in the order of ``stiffness`` (N m/deg)."""

    stiffness: tuple[float, ...]
    runs: tuple[Run, ...]

    @property
    def peak_force(self) -> Array:
        """Largest contact force of each run, N."""
        return np.array([r.key(NOTE)[2].max() for r in self.runs])

    @property
    def peak_angle(self) -> Array:
        """Largest key angle of each run, rad."""
        return np.array([r.key(NOTE)[0].max() for r in self.runs])

    @property
    def likeness(self) -> float:
        """Smallest correlation between the key angle of any run and that of the stiffest."""
        last = self.runs[-1].key(NOTE)[0]
        return float(min(np.corrcoef(r.key(NOTE)[0], last)[0, 1] for r in self.runs))

    @property
    def bulge(self) -> Array:
        """How much faster the force rises just after the key reaches its bed than just before, for
        each run.
        """
        bed = keyboard().mechanism.max_angle
        ratios = []
        for run in self.runs:
            angle, _, force = run.key(NOTE)
            at = int(np.argmax(angle >= bed))
            n = round(0.03 / (run.time[1] - run.time[0]))
            ratios.append((force[at + n] - force[at]) / max(force[at] - force[at - n], 1e-9))
        return np.array(ratios)


def single_note(stiffness: Sequence[float] = STIFFNESSES) -> SingleNote:
    """Press E4 with the middle finger at each ``stiffness`` (N m/deg)."""
    commands = strike_commands({"middle": NOTE}, MOTION)
    runs = play_batch([BatchJob(commands, k * DEGREE) for k in stiffness], reduced("middle", NOTE))
    return SingleNote(tuple(stiffness), tuple(runs))
