"""Scores: what is to be played, as strikes that one hand on one wrist can play.

A score is a phrase file (YAML, ``docs/phrases.md``) or a standard MIDI file. Both become a list of
:class:`ScoreStrike`; what hand and wrist cannot play is left out by name (MIDI) or refused
(phrases, which say exactly what they want). :func:`plan_score` makes setpoints of it.
"""

from pianobot_ros.cell.score.load import load_score, phrase_names
from pianobot_ros.cell.score.phrase import parse_phrase, read_phrase
from pianobot_ros.cell.score.plan import Plan, plan_retreat, plan_score
from pianobot_ros.cell.score.types import (
    Score,
    ScoreStrike,
    hold_for,
    motion_refusal,
    onset_delay,
    release_delay,
)

__all__ = [
    "Plan",
    "Score",
    "ScoreStrike",
    "hold_for",
    "load_score",
    "motion_refusal",
    "onset_delay",
    "parse_phrase",
    "phrase_names",
    "plan_retreat",
    "plan_score",
    "read_phrase",
    "release_delay",
]
