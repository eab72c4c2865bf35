"""What the name of a file or of a topic says."""

from __future__ import annotations

from itertools import pairwise

from pianobot_ros.axis.reading.headers.phrases import quantity_said, rank_of, unit_said
from pianobot_ros.axis.reading.headers.vocabulary import (
    ACTUAL,
    BODIES,
    COMMAND,
    FILLERS,
    JOINTS,
    OTHER,
    WORDS,
)
from pianobot_ros.axis.reading.headers.words import tokens

TOLD = ("position", "velocity", "effort", "acceleration")
"""Quantities that the name of a file may tell."""


def stem_says(stem: str) -> tuple[str, bool]:
    """Quantity ("" if none) and whether commanded, from a file's or a topic's name."""
    words = tokens(stem)
    quantity, _ = quantity_said(words)
    wanted = bool(set(words) & COMMAND) and not set(words) & ACTUAL
    return quantity if quantity in TOLD else "", wanted


def stem_rank(stem: str) -> int:
    """The rank of the efforts that a file's name says: torque before current."""
    quantity, found = quantity_said(tokens(stem))
    return rank_of(quantity, set(tokens(stem)), found)


def stem_unit(stem: str) -> str:
    """The unit of the efforts that a file's name says (`torques`: Nm), or ""."""
    return unit_said(tokens(stem), "effort")


def stem_joint(stem: str) -> str:
    """The number of the joint that a file's name says (`joint2`, `motor_3_run`), or ""."""
    words = tokens(stem)
    pairs = pairwise(words)
    return next((str(int(b)) for a, b in pairs if a in JOINTS and b.isdigit()), "")


def stem_key(stem: str) -> tuple[str, ...]:
    """What is left of a file's name without words for quantity and role: equal for the files of one
    recording.
    """
    noise = COMMAND | ACTUAL | FILLERS | (OTHER - BODIES) | WORDS["position"] | WORDS["velocity"]
    noise |= WORDS["effort"] | WORDS["acceleration"] | WORDS["time"] | {"read", "record", "records"}
    return tuple(w for w in tokens(stem) if w not in noise)
