"""The blind check: emulated cells with hidden effects are recorded, diagnosed without the answers, and scored."""

from pianobot_ros.blind.make import make_cases
from pianobot_ros.blind.run import diagnose_cases
from pianobot_ros.blind.score import Score, score_cases

__all__ = ["Score", "diagnose_cases", "make_cases", "score_cases"]
