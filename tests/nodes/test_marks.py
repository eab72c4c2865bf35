"""What announced strikes say of a note: its length, and where on the key the finger is."""

from __future__ import annotations

import pytest
from pianobot_msgs.msg import StrikeMark

from pianobot_ros.cell.motion.geometry import pivot_radius
from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.session.marks import Marks


def mark(finger: str, note: int, start: float) -> StrikeMark:
    message = StrikeMark(finger=finger, note=note, note_length=2.5)
    message.header.stamp = common.time_msg(round(1e9 * start))
    message.end = common.time_msg(round(1e9 * (start + 1.0)))
    return message


def test_a_chord_is_told_from_its_notes_played_alone() -> None:
    marks = Marks()
    for one in (mark("thumb", 64, 10.0), mark("middle", 68, 10.0), mark("middle", 68, 20.0)):
        marks.add(one)
    assert marks.radius(68, 10.4) == pytest.approx(0.127, abs=1e-3)
    assert marks.radius(64, 10.4) == pytest.approx(0.215, abs=1e-3)
    assert marks.radius(68, 20.4) == pytest.approx(pivot_radius(68))
    found = marks.covering(64, 10.4)
    assert found is not None and found.note_length == 2.5


def test_what_was_not_announced_is_at_the_usual_point() -> None:
    marks = Marks()
    marks.add(mark("middle", 64, 10.0))
    assert marks.covering(64, 12.0) is None
    assert marks.radius(64, 12.0) == pivot_radius(64)
    assert marks.radius(62, 10.4) == pivot_radius(62)
