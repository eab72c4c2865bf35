"""The sequential loop: what it plays, when it ends, and that the cell's limits hold."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from piano_twin_cases import record

from pianobot_ros.cell.recordings.recording import Recording
from pianobot_ros.gap import Proposal
from pianobot_ros.gap.explain.experiment import information
from pianobot_ros.piano.gap.diagnosis import investigate as room
from pianobot_ros.piano.gap.diagnosis.investigate import Goal, investigate, playable
from pianobot_ros.piano.gap.diagnosis.proposals import candidate_strikes
from pianobot_ros.piano.gap.simulation.piano_twin import PianoTwin

FIRST = record(strikes=16)


def stand_in(
    monkeypatch: pytest.MonkeyPatch, certainty: list[float], leader: str = "hammer"
) -> None:
    """A diagnosis whose leader gets surer from call to call."""
    left = iter(certainty)

    def found(recordings: Any, **_: Any) -> Any:
        p = next(left)
        names = ((leader, p), ("let_off", 1.0 - p))
        candidates = tuple(SimpleNamespace(name=n, probability=x) for n, x in names)
        return SimpleNamespace(candidates=candidates, gap=SimpleNamespace(before=2.0))

    monkeypatch.setattr(room, "diagnose_recordings", found)


def offer(apart: float) -> Any:
    """Always the same offer, of strikes that set two hypotheses ``apart``."""

    def choose(twin: PianoTwin, found: Any, goal: Goal, places: int) -> list[Proposal]:
        blocks = candidate_strikes(twin, goal.seed)[:places]
        weight, distance = np.full(2, 0.5), apart * (1.0 - np.eye(2))
        gained = information(weight, distance)
        pair = ("hammer", "let_off")
        return [Proposal(b, gained, pair, {"force": 1.0}, weight, distance) for b in blocks]

    return choose


def play(phrase: dict[str, Any]) -> Recording:
    """The cell: as many strikes as the phrase asks for."""
    count = sum(s["repeats"] for s in phrase["strikes"])
    return replace(FIRST, strikes=FIRST.strikes[:count])


def test_it_ends_when_one_explanation_is_sure_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in(monkeypatch, [0.5, 0.8, 0.97])
    done = investigate(FIRST, play, Goal(strikes=60), choose=offer(5.0))
    assert (done.ended, done.strikes) == ("goal", 16 + 9 + 9)
    assert [s.leading[0][1] for s in done.steps] == [0.5, 0.8, 0.97]
    assert "hammer and let_off" in done.steps[0].purpose


@pytest.mark.parametrize(("apart", "ended"), [(5.0, "budget"), (1e-3, "nothing_tells")])
def test_a_cause_that_is_surely_unknown_is_no_goal(
    monkeypatch: pytest.MonkeyPatch, apart: float, ended: str
) -> None:
    stand_in(monkeypatch, [0.98] * 9, leader="unknown")
    done = investigate(FIRST, play, Goal(strikes=33), choose=offer(apart))
    assert (done.ended, done.strikes) == (ended, 31 if ended == "budget" else 16)


def test_the_goal_is_of_causes_that_strikes_can_tell_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in(monkeypatch, [0.94])  # the most that the diagnosis ever gives
    done = investigate(FIRST, play, Goal(strikes=60), choose=offer(5.0))
    assert (done.ended, done.strikes) == ("goal", 16)


def test_each_strike_may_be_predicted_as_often_however_many_there_are() -> None:
    goal = Goal(budget=40_000)
    assert [goal.budget_for(n) for n in (16, 40, 60, 80)] == [40_000, 40_000, 60_000, 80_000]


def test_it_never_plays_more_than_the_budget(monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in(monkeypatch, [0.5] * 9)
    done = investigate(FIRST, play, Goal(strikes=33), choose=offer(5.0))
    assert (done.ended, done.strikes) == ("budget", 16 + 9 + 6)


def test_it_ends_when_nothing_on_offer_tells_more(monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in(monkeypatch, [0.5] * 9)
    for nothing in (offer(1e-3), lambda *_: []):
        stand_in(monkeypatch, [0.5])
        done = investigate(FIRST, play, Goal(strikes=60), choose=nothing)
        assert (done.ended, done.strikes) == ("nothing_tells", 16)


def test_what_the_arm_must_not_play_is_not_proposed() -> None:
    twin = PianoTwin([FIRST])
    block = candidate_strikes(twin)[0]
    good = Proposal(block, 1.0, ("a", "b"), {})
    assert playable(good)
    fast = replace(block, attributes={**block.attributes, "speed": 50.0})
    assert not playable(Proposal(fast, 1.0, ("a", "b"), {}))
