"""The two clocks of a machine, one against the other."""

from __future__ import annotations

import time

import pytest

from pianobot_ros.cell.host.wall_clock import WallClock, wall_offset_ns


def bounds() -> tuple[int, int]:
    """Between which the offset lies, ns: the farther apart the longer this process was held up."""
    before, wall, after = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
    return wall - after, wall - before


def test_the_offset_lies_between_readings_around_it() -> None:
    first = bounds()
    offset = wall_offset_ns()
    second = bounds()
    assert min(*first, *second) - 10_000_000 < offset < max(*first, *second) + 10_000_000


def test_there_and_back_again() -> None:
    clock = WallClock()
    now = time.monotonic()
    # Within a second it is the same offset; where this process was held up, a measured one.
    assert clock.monotonic(clock.wall_ns(now)) == pytest.approx(now, abs=0.02)
    before = time.time_ns()
    wall = clock.wall_ns(time.monotonic())
    assert before - 1_000_000_000 < wall < time.time_ns() + 1_000_000_000
