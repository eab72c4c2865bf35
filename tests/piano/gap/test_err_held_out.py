"""Err of Eq. 5 on strikes that were not fitted: what tells a false cure."""

from __future__ import annotations

import pytest
from piano_twin_cases import record

from pianobot_ros.gap.diagnosis import Fold, Offer
from pianobot_ros.piano.gap.diagnosis.err_held_out import err_held_out
from pianobot_ros.piano.gap.simulation.piano_twin import PianoTwin


def offered(twin: PianoTwin, values: dict[str, float], effects: tuple[str, ...] = ()) -> Offer:
    """An offer whose values are the same in both folds."""
    names = [b.name for b in twin.blocks]
    return Offer(effects, (Fold(tuple(names[::2]), values), Fold(tuple(names[1::2]), values)))


def test_right_values_lower_err_and_wrong_ones_raise_it_for_certain() -> None:
    twin = PianoTwin([record(errors=(("midi_velocity_gain", 0.15),))])
    right = err_held_out(offered(twin, {"midi_velocity_gain": 1.15}), twin)
    wrong = err_held_out(offered(twin, {"midi_velocity_gain": 0.9}), twin)
    assert right is not None and wrong is not None
    assert right.before == wrong.before == pytest.approx(0.8 * 0.15 / 1.15, abs=0.02)
    assert right.after < 0.3 * right.before and right.high < 0.0
    assert wrong.after > 1.5 * wrong.before and wrong.low > 0.0


def test_a_gain_that_makes_up_for_an_effect_is_told_from_one_that_stands_alone() -> None:
    """A gain fitted beside a curve of the velocity is right with it and wrong without."""
    values = {
        "midi_velocity_gain": 1.17,
        "midi_velocity_curve": 0.084,
        "midi_velocity_shape": -0.01,
    }
    twin = PianoTwin([record(effects=(("midi_velocity_curve", 3.0),))])
    beside = err_held_out(offered(twin, values, ("midi_velocity_curve",)), twin)
    alone = err_held_out(offered(twin, {"midi_velocity_gain": 1.17}), twin)
    assert beside is not None and alone is not None
    assert alone.after > beside.after


def test_nothing_offered_is_not_measured() -> None:
    assert err_held_out(Offer(), PianoTwin([record()])) is None
