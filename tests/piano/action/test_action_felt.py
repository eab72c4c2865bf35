"""Felt by Hunt and Crossley: what it does at touch and parting, and that the compiled key with its
hammer is the exact model where the felt is a plain spring.
"""

from __future__ import annotations

import numpy as np
import pytest

from pianobot_ros.piano.action import ActionParameters
from pianobot_ros.piano.action.felt import FELTS, FeltAction, felt_force, felts_of
from pianobot_ros.piano.action.hybrid.action_model import build_model
from pianobot_ros.piano.action.hybrid.force_profile import ForceProfile
from pianobot_ros.piano.action.hybrid.simulator import Simulator

STEP = 2e-5


def test_no_jump_at_touch_no_pull_at_parting(parameters: ActionParameters) -> None:
    for felt in felts_of(parameters):
        assert felt_force(-1e-3, 1.0, felt) == felt_force(0.0, 1.0, felt) == 0.0
        assert felt_force(1e-9, 1.0, felt) < 1e-6
        assert felt_force(1e-4, -1e3, felt) == 0.0
        assert felt_force(1e-3, 0.1, felt) > felt_force(1e-3, 0.0, felt) > 0.0


def test_as_stiff_as_the_table_at_its_force_and_stiffer_beyond(
    parameters: ActionParameters,
) -> None:
    rail = felts_of(parameters)[FELTS.index("front rail")]
    force, linear = parameters.felt.force, parameters.front_rail.stiffness
    assert felt_force(force / linear, 0.0, rail) == pytest.approx(force)
    assert felt_force(2 * force / linear, 0.0, rail) > 4 * force


@pytest.mark.long
def test_plain_springs_are_the_exact_hybrid_model(parameters: ActionParameters) -> None:
    springs = parameters.vary("hammer", coupler_damping=0.0).vary("front_rail", damping=0.0)
    felts = np.array(
        [
            [springs.hammer.coupler_stiffness, 1.0, 0.0],
            [springs.front_rail.stiffness, 1.0, 0.0],
            [0.0, 1.0, 0.0],
        ]
    )
    exact = Simulator(build_model(springs)).run(ForceProfile.step(4.1), 0.15).sample(STEP)
    model = FeltAction(springs, felts, armature=True)
    start = exact.key[0]
    felt = model.press(np.full(7500, 4.1))
    assert start == pytest.approx(felt.key[0], abs=2e-3)
    peak = exact.key.max()
    assert felt.key.max() == pytest.approx(peak, rel=0.05)


def test_a_tenth_of_the_step_changes_nothing(parameters: ActionParameters) -> None:
    model = FeltAction(parameters)
    coarse, fine = model.press(np.full(5000, 5.0)), model.press(np.full(50000, 5.0), STEP / 10)
    np.testing.assert_allclose(coarse.key, fine.key[::10], atol=2e-6)
    np.testing.assert_allclose(coarse.hammer, fine.hammer[::10], atol=2e-6)


def test_felt_takes_energy_and_gives_none(parameters: ActionParameters) -> None:
    """Without pushing, dampers and weight: what key and hammer have between them only falls."""
    free = (
        parameters.vary("hammer", weight=1e-9, bushing_damping=0.0)
        .vary("key", damping=0.0)
        .vary("string", height=0.002)
    )
    acceleration = np.zeros(20000)
    model = FeltAction(free)
    pushed = model.press(np.concatenate([np.full(1000, 5.0), acceleration]))
    energy = (
        free.key.mass * pushed.key_velocity**2 + free.hammer.mass * pushed.hammer_velocity**2
    ) / 2
    apart = (pushed.key < pushed.hammer) & (pushed.key < free.key.dip)
    apart &= (pushed.hammer < free.string.height) & (pushed.time > 0.02)
    flying = energy[apart]
    assert flying.size > 100 and np.all(np.diff(flying) < 1e-9)
