from __future__ import annotations

import numpy as np
import pytest

from pianobot_ros.piano.action import ActionParameters
from pianobot_ros.piano.action.hybrid.action_model import PARTS, build_model
from pianobot_ros.piano.action.hybrid.force_profile import ForceProfile
from pianobot_ros.piano.action.hybrid.simulator import Simulator, simulate
from pianobot_ros.piano.action.results.features import repeated_note, strike_timing, strikes_string


def test_without_let_off_the_hammer_blocks_the_string(parameters: ActionParameters) -> None:
    press = ForceProfile.step(5.0)
    with_let_off = simulate(build_model(parameters, PARTS), press, 0.3)
    without = simulate(build_model(parameters, {"back_rail", "string"}), press, 0.3)
    assert len(strikes_string(with_let_off)) == 1
    assert len(strikes_string(without)) > 1
    assert with_let_off.sample().hammer[-1] < parameters.string.height - 1e-3
    assert without.sample().hammer[-1] > parameters.string.height, (
        "pressed against the string for good"
    )


def test_hammer_flies_the_last_stretch_alone(parameters: ActionParameters) -> None:
    path = simulate(build_model(parameters, PARTS), ForceProfile.step(5.0), 0.1)
    out = next(e for e in path.events if e.rule == "jack out")
    struck = next(e for e in path.events if e.rule == "string made")
    assert out.time < struck.time
    times = np.linspace(out.time + 1e-6, struck.time - 1e-6, 50)
    _, modes = path.states(times)
    assert not any(mode & {"coupler", "lever", "lever_screw", "check"} for mode in modes)


@pytest.mark.parametrize("press", [4.0, 5.0, 8.0])
def test_backcheck_catches_the_hammer_where_the_paper_says(
    parameters: ActionParameters, press: float
) -> None:
    path = simulate(build_model(parameters, PARTS), ForceProfile.step(press), 0.5)
    assert "hammer checked" in [e.rule for e in path.events]
    h = path.sample()
    held = slice(-100, None)
    assert np.ptp(h.hammer[held] - h.key[held]) < 1e-4, "held against the key"
    below = (parameters.string.height - h.hammer[-1]) * parameters.hammer.advantage
    assert 0.003 < below < 0.015, (
        "suspended below the string, 12 to 15 mm if the rail did not give under the key"
    )


@pytest.mark.parametrize("ease", [1.0, 1.5])
def test_a_repeated_note_needs_the_repetition_lever(
    parameters: ActionParameters, ease: float
) -> None:
    lever = repeated_note(parameters, lever=True, ease=ease)
    single = repeated_note(parameters, lever=False, ease=ease)
    assert len(strikes_string(lever)) == 2
    assert len(strikes_string(single)) == 1
    between = lever.sample()
    inside = (between.time > 0.15) & (between.time < 0.26)
    assert between.key[inside].min() > 0.2 * parameters.key.dip, (
        "the key must not return all the way"
    )
    rules = [e.rule for e in lever.events]
    assert any(
        r.startswith("jack back")
        for r in rules[: rules.index("let-off begins", rules.index("jack out") + 1)]
    )


def test_without_lever_the_note_repeats_after_a_full_return(parameters: ActionParameters) -> None:
    profile = ForceProfile.steps([(0.0, 5.0), (0.15, 0.0), (0.6, 5.0), (0.8, 0.0)])
    for parts in (PARTS, PARTS - {"repetition_lever"}):
        assert len(strikes_string(simulate(build_model(parameters, parts), profile, 1.0))) == 2


def test_every_part_can_be_switched_off(parameters: ActionParameters) -> None:
    for part in sorted(PARTS - {"let_off", "back_rail"}):
        path = simulate(build_model(parameters, PARTS - {part}), ForceProfile.step(5.0), 0.2)
        names = {name for segment in path.segments for name in segment.mode}
        hidden = {"repetition_lever": "lever_screw", "backcheck": "check", "string": "string"}[part]
        assert hidden not in names


def test_lag_between_key_and_hammer_is_of_the_measured_size(parameters: ActionParameters) -> None:
    simulator = Simulator(build_model(parameters, PARTS))
    soft = strike_timing(simulator.run(ForceProfile((0.0, 0.2), (0.0, 3.4)), 0.5))
    middle = strike_timing(simulator.run(ForceProfile.step(4.0), 0.5))
    loud = strike_timing(simulator.run(ForceProfile.step(12.0), 0.5))
    assert soft.hammer_speed < middle.hammer_speed < loud.hammer_speed
    lit = parameters.expected
    assert middle.free_flight == pytest.approx(lit.key_to_hammer_fast, abs=1.5e-3)
    assert soft.free_flight == pytest.approx(lit.key_to_hammer_slow, abs=3.5e-3)
    assert soft.bottom_after_contact > 0 > loud.bottom_after_contact, (
        "the key bottoms last when soft, first when loud"
    )
    assert soft.bottom_after_contact == pytest.approx(lit.bottom_after_contact_piano, abs=4e-3)
