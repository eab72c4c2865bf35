"""The blind check: emulated cells with hidden effects are recorded, diagnosed without the answers, and scored."""

from pianobot_ros.cell_gap.blind.make import make_cases
from pianobot_ros.cell_gap.blind.run import diagnose_cases
from pianobot_ros.cell_gap.blind.score import Score, score_cases

__all__ = ["Score", "diagnose_cases", "make_cases", "score_cases"]
