"""Announced strikes, kept for what a note itself does not say: its length, and where on the key the
finger is.
"""

from __future__ import annotations

from collections import deque
from typing import Any

from pianobot_msgs.msg import StrikeMark

from pianobot_ros.cell.messages.events import STRIKE_NUMBERS, STRIKE_WORDS
from pianobot_ros.cell.motion.geometry import FINGERS, keyboard
from pianobot_ros.cell.recordings.contact_radius import planned_radius, played_together
from pianobot_ros.cell.recordings.recording import Strike
from pianobot_ros.nodes.base import common

__all__ = ["Marks", "mark_message"]

MEMORY = 64  # strikes


def mark_message(strike: Strike, origin_ns: int) -> StrikeMark:
    """The announcement of a strike; ``origin_ns``: its time 0, ns since the epoch."""
    said: dict[str, Any] = {name: getattr(strike, name) for name in STRIKE_WORDS}
    message = StrikeMark(**said, **{name: float(getattr(strike, name)) for name in STRIKE_NUMBERS})
    message.header.stamp = common.time_msg(origin_ns + round(1e9 * strike.start))
    message.end = common.time_msg(origin_ns + round(1e9 * strike.end))
    return message


class Marks:
    """The latest announced strikes; may be asked from another thread than the one that adds.

    What a chord needs is loaded when this is made: SciPy's optimiser, imported at the first one,
    would keep the processor from the arm's driver amid a phrase, at the node's real-time priority.
    """

    def __init__(self) -> None:
        self._marks: deque[StrikeMark] = deque(maxlen=MEMORY)
        notes = keyboard().notes
        planned_radius(notes[2], {FINGERS[0]: notes[2], FINGERS[-1]: notes[6]})

    def add(self, mark: StrikeMark) -> None:
        """Keep an announcement; where the hand lands is worked out now and not with the note."""
        self._marks.append(mark)
        self.of(mark)

    def covering(self, note: int, onset: float) -> StrikeMark | None:
        """The latest strike of ``note`` in whose window ``onset`` s lies."""
        for mark in reversed(tuple(self._marks)):
            covered = common.seconds(mark.header.stamp) <= onset <= common.seconds(mark.end)
            if mark.note == note and covered:
                return mark
        return None

    def radius(self, note: int, onset: float) -> float:
        """r of Eq. 2 (m) of a note: where the plan lands the finger, the key's usual contact point
        where nothing was announced.
        """
        mark = self.covering(note, onset)
        return planned_radius(note, {}) if mark is None else self.of(mark)

    def of(self, mark: StrikeMark) -> float:
        """r of Eq. 2 (m) of an announced strike."""
        known = [(common.seconds(m.header.stamp), m.finger, m.note) for m in tuple(self._marks)]
        chord = played_together(known, common.seconds(mark.header.stamp), mark.note)
        return planned_radius(mark.note, chord)
