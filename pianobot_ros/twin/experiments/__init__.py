"""The soft-hand paper's experiments (V-A, Figs. 7 and 8) on the twin, and its hand on the other
paper's action.
"""

from pianobot_ros.twin.experiments.glissando import GlissandoRun, glissando
from pianobot_ros.twin.experiments.repetition import Repetition, repetition
from pianobot_ros.twin.experiments.single_note import SingleNote, single_note
from pianobot_ros.twin.experiments.two_notes import TwoNotes, two_notes

__all__ = [
    "GlissandoRun",
    "Repetition",
    "SingleNote",
    "TwoNotes",
    "glissando",
    "repetition",
    "single_note",
    "two_notes",
]
