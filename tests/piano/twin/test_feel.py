"""What key and finger feel of each other, and Fig. 8(c)'s two notes struck twice."""

from __future__ import annotations

import numpy as np
import pytest

from pianobot_ros.piano.action import load_parameters
from pianobot_ros.piano.action.rig.linear import transfer_function
from pianobot_ros.piano.twin.experiments.feel import (
    assumed,
    contact_friction,
    finger_impedance,
    key_impedance,
    presses,
    second_order,
    tip_displacement,
)
from pianobot_ros.piano.twin.experiments.two_notes import G_SHARP, E, margins, two_notes
from pianobot_ros.piano.twin.reduced.strike_geometry import finger_model

DEGREE = 180 / np.pi


def test_a_stiffer_finger_yields_less_and_softly_loaded_as_its_jacobian_says() -> None:
    soft, stiff = (tip_displacement(k * DEGREE, [0.0, 1e-3, 2.0]) for k in (0.1, 1.0))
    assert soft[0] == stiff[0] == 0.0 and np.all(soft[1:] > stiff[1:])
    model = finger_model("middle")
    lever = np.cumsum((model.length * np.cos(model.pitch))[::-1])
    by_hand = lever @ lever / (0.1 * DEGREE) + 1 / model.pad_stiffness
    assert soft[1] / 1e-3 == pytest.approx(by_hand, rel=1e-3)


def test_slow_motion_meets_the_static_stiffness() -> None:
    static = 1e-3 / tip_displacement(0.2 * DEGREE, [1e-3])[0]
    slow = finger_impedance(0.2 * DEGREE, np.array([0.01]))[0]
    assert abs(slow) * 2 * np.pi * 0.01 == pytest.approx(static, rel=1e-3)


def test_key_and_voice_coil_together_are_the_rig() -> None:
    p, frequency = load_parameters(), np.array([2.0, 16.0, 25.0])
    a = p.armature
    whole = key_impedance(p, frequency) + second_order(a.mass, a.damping, a.stiffness, frequency)
    rig = transfer_function(p, "AKWH")(frequency)
    np.testing.assert_allclose(1 / (2j * np.pi * frequency * whole), rig, rtol=1e-9)


def test_friction_stays_within_its_cone_and_reaches_it() -> None:
    found = contact_friction()
    assert np.all(np.abs(found.friction) <= 1.001 * found.coefficient * found.normal + 1e-6)
    assert 0.2 < found.slipping < 1.0
    assert found.normal.max() > 5.0


def test_each_note_is_struck_twice_with_room_to_either_side() -> None:
    two = two_notes()
    for note in (E, G_SHARP):
        slow, swift = two.strokes(note)
        assert swift.t_hold < 0.5 * slow.t_hold
    for m in margins():
        assert m.sounded and m.short > 1.5e-3 and m.pressed > 1.5e-3


def test_felt_gives_way_less_than_a_spring_the_harder_it_is_pressed() -> None:
    found = {(p.preset, p.stiffness): p for p in presses()}
    for preset in ("digital", "acoustic"):
        soft, hard = found[preset, 0.1], found[preset, 2.0]
        assert hard.past < 0.7 * hard.past_springs
        assert 0.8 * soft.past_springs < soft.past < 1.05 * soft.past_springs
    assert found["paper", 2.0].past == found["paper", 2.0].past_springs


def test_what_is_assumed_of_the_keys_has_a_range_and_moves_something() -> None:
    found = {(a.preset, a.name, a.value): a.changes for a in assumed()}
    peak, v_pre, v_rel, t_hold = found["digital", "moving_mass", 0.12]
    assert v_pre > 0.1 and v_rel < -0.05 and t_hold > 0.01 and abs(peak) < 0.05
    assert {name for _, name, _ in found} >= {"damping", "rest_damping", "stiffness", "felt_power"}
    assert all(
        max(map(abs, x)) < 1e-3 for (p, n, _), x in found.items() if (p, n[:4]) == ("paper", "rest")
    )
