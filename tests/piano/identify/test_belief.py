"""What is known of a cell, and what it says of a strike to come."""

from __future__ import annotations

import numpy as np
import pytest

from pianobot_ros.cell.motion.geometry import keyboard
from pianobot_ros.cell.motion.strike_motion import StrikeMotion
from pianobot_ros.piano.identify.cell.belief import (
    Belief,
    belief_before,
    spread_of,
    stiffness_factor,
)
from pianobot_ros.piano.identify.cell.dynamics import Wanted, play, solve
from pianobot_ros.piano.identify.priors import prior_of


def test_the_prior_makes_the_nominal_strike_and_owns_its_doubt() -> None:
    (known,) = solve([Wanted(64, 47, 0.3)])
    gain = 47 * prior_of("midi_velocity_gain").sd
    assert known.velocity == pytest.approx(47, abs=0.6)
    assert known.velocity_error > 1.6 * gain
    assert 0 < known.t_hold_error < 0.1


def test_a_gain_that_is_known_moves_the_wrist_and_narrows_the_interval() -> None:
    before = belief_before()
    names = [p.name for p in before.parameters]
    at = np.zeros(len(names))
    at[names.index("midi_velocity_gain")] = prior_of("midi_velocity_gain").coordinate(1.15)
    sure = Belief(before.parameters, at, 1e-4 * np.eye(len(names)))
    wanted = Wanted(64, 47, 0.3)
    (informed,), (nominal,) = solve([wanted], belief=sure), solve([wanted])
    assert informed.velocity_error < 0.05 * nominal.velocity_error
    assert informed.motion.speed < nominal.motion.speed
    keystroke, _ = play(informed.motion, 64, informed.pressure)
    assert keystroke is not None
    heard = 1.15 * keyboard().midi.velocity_gain * keystroke.v_pre
    assert heard == pytest.approx(47, abs=1.0)


def test_stiffness_goes_between_levels_and_with_the_finger() -> None:
    values = {"joint_stiffness -100 kPa": 4.0, "joint_stiffness 0 kPa": 1.0}
    assert stiffness_factor(values, -50e3, "middle") == pytest.approx(2.0)
    assert stiffness_factor({"finger_stiffness thumb": 1.1}, 0.0, "thumb") == pytest.approx(1.1)
    soft, _ = play(StrikeMotion(0.15, 0.014, 0.3), 64, -50e3, values={"joint_stiffness": 0.5})
    stiff, _ = play(StrikeMotion(0.15, 0.014, 0.3), 64, -50e3)
    assert soft is not None and stiff is not None and soft.v_rel < 0.95 * stiff.v_rel


def test_where_the_note_may_fail_nothing_is_promised() -> None:
    before = belief_before()
    first = before.parameters[0].name

    def predict(values: object) -> tuple[float, ...] | None:
        return (1.0,) if values == before.values() else None

    assert np.isnan(spread_of(before, predict)[0]), first
