"""Numbers and motions as a reader sees them."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from pianobot_ros.cell.numbers.shown import in_kpa
from pianobot_ros.cell.recordings.recording import Strike

MARK = Strike(0, "", "", "middle", 64, 0.0, 1.0, 0.12, 0.01, 0.3, 0.0, 1.0)


@given(st.floats(-499.0, 499.0))
def test_around_nothing_there_is_one_level(pressure: float) -> None:
    assert in_kpa(pressure) == "0 kPa"
    assert replace(MARK, pressure=pressure).motion == MARK.motion


def test_a_motion_is_told_with_its_units() -> None:
    assert replace(MARK, pressure=-50_100.0).motion == "middle 64 0.12 m/s 10 mm 0.3 s -50 kPa"
