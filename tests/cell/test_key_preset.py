"""Key presets: one choice for twin, plant and searches."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.cell.motion import geometry
from pianobot_ros.emulator.plant.laws.row_layout import KEY_INERTIA
from pianobot_ros.emulator.plant.mechanics.physics import plant_parameters
from pianobot_ros.piano.twin.reduced.strike_geometry import key_model

Choose = Callable[[str], None]


def test_an_acoustic_key_has_the_inertia_of_the_action_paper_in_both_cells(
    choose_keys: Choose,
) -> None:
    choose_keys("acoustic")
    radius = geometry.keyboard().mechanism.reference_radius
    assert key_model(64).inertia / radius**2 == pytest.approx(0.207, rel=0.01)
    plant = plant_parameters()
    assert plant.board[4, KEY_INERTIA] == pytest.approx(key_model(64).inertia, rel=0.01)
    assert plant.plant.key_friction == pytest.approx(key_model(64).friction) and (
        key_model(64).friction > 0
    )
    assert plant.plant.felt_power == key_model(64).felt_power > 1
    choose_keys("paper")
    assert plant_parameters().plant.felt_power == key_model(64).felt_power == 1
    assert key_model(64).inertia / radius**2 == pytest.approx(0.019, rel=0.05)
    assert plant_parameters().plant.key_friction == 0.0


@pytest.mark.parametrize("keys", ["digital", "acoustic"])
def test_a_hammers_weight_is_40_g_over_the_dip_and_more_than_friction(
    keys: str, choose_keys: Choose
) -> None:
    choose_keys(keys)
    m, plant = geometry.keyboard().mechanism, plant_parameters(factors={"key_stiffness": 1.1}).plant
    mean = m.preload + m.stiffness * m.max_angle / 2 / m.reference_radius
    assert mean == pytest.approx(0.040 * 9.81, rel=0.01)
    assert m.preload > 2 * m.dry_friction
    assert plant.resting_torque == pytest.approx(1.1 * key_model(64).preload)
    assert plant.rest_angle == key_model(64).rest_angle > 0


def test_a_keyboard_of_another_preset_may_be_given(choose_keys: Choose) -> None:
    boards = {}
    for name in ("paper", "acoustic"):
        choose_keys(name)
        boards[name] = geometry.keyboard()
    choose_keys("paper")
    assert key_model(64, boards["paper"]).inertia == key_model(64).inertia
    assert key_model(64, boards["acoustic"]).inertia > 5 * key_model(64).inertia
    assert hash(boards["paper"]) == hash(geometry.keyboard()) != hash(boards["acoustic"])


def test_an_unknown_preset_is_refused_and_changes_nothing(choose_keys: Choose) -> None:
    before = geometry.keyboard()
    with pytest.raises(ConfigError, match="did you mean 'acoustic'"):
        choose_keys("acustic")
    assert geometry.keyboard() == before
