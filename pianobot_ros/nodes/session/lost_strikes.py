"""What became of the strikes of a phrase, and which of them are to be played once more.

A strike is lost if it was not played, if the arm did not follow in its window, if one cell alone
did not obey its commands as given, or if it sounded on one cell and not on the other. One that
sounded on neither, while both followed, is as the phrase wants it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from pianobot_ros.cell.recordings.recording import Strike

__all__ = ["ARRIVAL", "LATE", "REPEATS", "Passage", "why_lost"]

REPEATS = 2
"""How often a lost strike is played once more, at the end of the phrase."""

ARRIVAL = 1.0
"""Seconds after a strike's window within which its notes have arrived: a reliable message that was
lost on the way is sent again within a few tenths of a second (``config/dds.xml``)."""

LATE = 0.012
"""Seconds after its time from which a setpoint is late: one and a half periods of the stream."""

BEFORE = 0.1  # s before a strike's window in which a wrist that is not obeyed spoils it


@dataclass
class Passage:
    """One passage through a plan.

    Attributes: ``epoch`` of the plan's time 0, s; ``begun``, marks whose window has begun;
    ``announced``, marks that were sent; ``trouble``, times of the plan at which a cell did not
    obey or setpoints came late, s; ``reasons`` why it was given up, empty if it was played to its
    end.
    """

    epoch: float
    begun: int = 0
    announced: int = 0
    trouble: list[float] = field(default_factory=list)
    reasons: list[str] = field(default_factory=list)

    def spoilt(self, mark: Strike) -> bool:
        """Whether there was trouble in the window of ``mark``."""
        return any(mark.start - BEFORE <= t <= mark.end for t in self.trouble)


def why_lost(
    take: Passage, number: int, mark: Strike, sounded: Mapping[str, bool], apart: str = ""
) -> str:
    """Why the strike does not count, in words; empty if it does.

    Args:
        take: the passage in which it was played.
        number: place of ``mark`` among the marks of the plan.
        mark: the strike.
        sounded: by cell whether its note was heard; cells whose notes nobody publishes are left
            out.
        apart: what one cell alone did not obey in the strike's window, in words.
    """
    if number >= take.begun:
        return "was not played"
    if take.spoilt(mark):
        return "the arm did not follow"
    if apart:
        return apart
    if all(sounded.values()) or (len(sounded) > 1 and not any(sounded.values())):
        return ""
    silent = next(cell for cell, heard in sounded.items() if not heard)
    return f"silent on the {silent} cell"
