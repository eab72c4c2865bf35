"""The soft-hand paper's experiments (V-A, Figs. 7 and 8) on the twin, and their results beside the paper's."""

from pianobot_ros.twin.experiments.glissando import Glissando, glissando
from pianobot_ros.twin.experiments.single_note import SingleNote, single_note
from pianobot_ros.twin.experiments.two_notes import TwoNotes, two_notes

__all__ = ["Glissando", "SingleNote", "TwoNotes", "glissando", "single_note", "two_notes"]
