from __future__ import annotations

import numpy as np
import pytest
from action_strategies import actions
from examples import fewer
from hypothesis import given
from hypothesis import strategies as st

from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.piano.action import ActionParameters
from pianobot_ros.piano.action.rig.linear import (
    PREPARATIONS,
    Preparation,
    antiresonance,
    damping_ratio,
    natural_frequency,
    resonance,
    state_space,
    transfer_function,
)


@given(actions(), st.sampled_from(PREPARATIONS), st.floats(0.1, 200.0))
@fewer(0.6)
def test_transfer_function_is_that_of_the_state_space(
    p: ActionParameters, kind: Preparation, frequency: float
) -> None:
    model = state_space(p, kind)
    direct = model.C @ np.linalg.solve(
        2j * np.pi * frequency * np.eye(len(model.A)) - model.A, model.B
    )
    assert transfer_function(p, kind)(frequency) == pytest.approx(direct, rel=1e-6)


@given(actions(), st.sampled_from(PREPARATIONS))
@fewer(0.6)
def test_every_preparation_is_stable_and_gives_the_flexure_at_rest(
    p: ActionParameters, kind: Preparation
) -> None:
    model = transfer_function(p, kind)
    assert np.all(model.poles.real < 0)
    assert model(0.0) == pytest.approx(1.0 / p.armature.stiffness)


def test_numerator_is_one_for_force_and_the_motor_constant_for_current(
    parameters: ActionParameters,
) -> None:
    force, current = (
        transfer_function(parameters, "A"),
        transfer_function(parameters, "A", "current"),
    )
    assert force.numerator == (1.0,)
    assert current(3.0) / force(3.0) == pytest.approx(2.05)


def test_table_two_contradicts_the_text(parameters: ActionParameters) -> None:
    """The slips reported in docs/physics-action.md, as numbers."""
    a, k = parameters.armature, parameters.key
    assert natural_frequency(a.mass, a.stiffness) == pytest.approx(7.44, abs=0.01)
    assert damping_ratio(a.mass, a.damping, a.stiffness) == pytest.approx(0.33, abs=0.005)
    assert damping_ratio(a.mass + k.mass, a.damping + k.damping, a.stiffness) == pytest.approx(
        0.51, abs=0.005
    )
    assert natural_frequency(a.mass + k.mass, a.stiffness) < natural_frequency(a.mass, a.stiffness)
    assert antiresonance(parameters, damped=True) == pytest.approx(16.4, abs=0.05)
    assert resonance(parameters, damped=True) == pytest.approx(24.7, abs=0.05)


def test_undamped_antiresonance_is_the_zero_without_damping(parameters: ActionParameters) -> None:
    quiet = parameters.vary("hammer", coupler_damping=0.0, bushing_damping=0.0)
    zeros = transfer_function(quiet, "AKWH").zeros
    assert np.max(np.abs(zeros.imag)) / (2 * np.pi) == pytest.approx(antiresonance(parameters))
    assert resonance(parameters) > antiresonance(parameters)


def test_whippen_adds_nothing_as_in_the_paper(parameters: ActionParameters) -> None:
    assert transfer_function(parameters, "AKW") == transfer_function(parameters, "AK")
    assert transfer_function(parameters.vary("key", whippen_mass=0.01), "AKW") != transfer_function(
        parameters, "AK"
    )


def test_unknown_preparation_and_smoothed_resonance_are_refused(
    parameters: ActionParameters,
) -> None:
    with pytest.raises(ConfigError, match="unknown preparation 'AKX'"):
        transfer_function(parameters, "AKX")  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="no resonance"):
        resonance(parameters.vary("hammer", coupler_damping=60.0), damped=True)
