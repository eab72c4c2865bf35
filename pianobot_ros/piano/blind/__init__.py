"""The blind check: emulated cells with hidden effects are recorded, diagnosed without the answers,
and scored.
"""

from pianobot_ros.piano.blind.make import Design, make_cases
from pianobot_ros.piano.blind.run import diagnose_cases
from pianobot_ros.piano.blind.scorecard import Scorecard, score_cases

__all__ = ["Design", "Scorecard", "diagnose_cases", "make_cases", "score_cases"]
