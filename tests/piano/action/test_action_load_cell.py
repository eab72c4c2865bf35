"""What the load cell tells without the armature, the rail under a press, the coil made linear."""

from __future__ import annotations

import numpy as np
import pytest

from pianobot_ros.piano.action import ActionParameters
from pianobot_ros.piano.action.rig.linear import transfer_function
from pianobot_ros.piano.action.rig.linearise import linearise
from pianobot_ros.piano.action.rig.load_cell import compliance, driving_point, press_rail

SHORT = 60.0  # s of noise


@pytest.mark.parametrize("preparation", ["AK", "AKWH"])
def test_key_and_armature_side_by_side_are_the_paper_model(
    parameters: ActionParameters, preparation: str
) -> None:
    frequency = np.array([1.0, 8.0, 16.0, 40.0])
    s = 2j * np.pi * frequency
    a = parameters.armature
    armature = a.mass * s**2 + a.damping * s + a.stiffness
    own = 1.0 / compliance(parameters, preparation, frequency)  # type: ignore[arg-type]
    whole = transfer_function(parameters, preparation)(frequency)  # type: ignore[arg-type]
    np.testing.assert_allclose(1.0 / (own + armature), whole, rtol=1e-9)


@pytest.mark.long
def test_the_load_cell_alone_finds_key_and_hammer(parameters: ActionParameters) -> None:
    key = driving_point(parameters, "AK", seed=1, duration=SHORT)
    hammer = driving_point(parameters, "AKWH", seed=2, duration=SHORT, known=key.parameters)
    for point in (key, hammer):
        for (section, field), e in point.estimates.items():
            truth = getattr(getattr(parameters, section), field)
            assert e.value == pytest.approx(truth, rel=0.015), field


def test_the_armature_plays_no_part_in_it(parameters: ActionParameters) -> None:
    other = parameters.vary("armature", stiffness=600.0, damping=8.0)
    key = driving_point(other, "AK", seed=3, duration=SHORT)
    assert key.estimates["key", "damping"].value == pytest.approx(2.46, rel=0.02)


def test_pressing_the_rail_finds_its_felt(parameters: ActionParameters) -> None:
    soft = parameters.vary("front_rail", stiffness=1500.0, damping=8.0)
    for p in (parameters, soft):
        found = press_rail(p, seed=5)
        assert found.stiffness.value == pytest.approx(p.front_rail.stiffness, rel=0.01)
        assert found.damping.value == pytest.approx(p.front_rail.damping, rel=0.05)
        assert found.displacement.max() > p.key.dip + 1e-3


def test_the_third_order_makes_a_bent_coil_straight(parameters: ActionParameters) -> None:
    found = linearise(parameters, seed=0)
    assert found.off_before > 0.1 and found.off_after < 0.01
    assert found.stiffness == pytest.approx(parameters.armature.stiffness, rel=0.005)
    straight = parameters.vary("curve", weight=0.0, quadratic=0.0, cubic=0.0)
    assert linearise(straight, seed=0).off_before < 0.005
