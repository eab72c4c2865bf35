"""Silence is what one has listened to, not what one has slept through."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pianobot_ros.devices import waiting
from pianobot_ros.devices.waiting import Waiting

TURN = 0.25  # s


@given(st.lists(st.floats(0.0, 10.0), max_size=20), st.floats(0.0, 10.0))
def test_a_turn_counts_for_no_longer_than_it_may_take(took: list[float], stall: float) -> None:
    now = 100.0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(waiting, "time", SimpleNamespace(monotonic=lambda: now))
        silence = Waiting(TURN)
        for seconds in took:
            now += seconds
            silence.turn()
        assert silence.seconds == pytest.approx(sum(min(s, TURN) for s in took), abs=1e-9)
        now += stall
        silence.begin()
        assert silence.turn() == 0.0
