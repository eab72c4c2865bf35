"""The felt of a key's stops: in the reduced model and in the plant, which share no code."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pianobot_ros.cell.motion.geometry import keyboard
from pianobot_ros.emulator.plant.laws.key import stop_felt
from pianobot_ros.piano.twin.reduced.strike_laws import rail_felt

POWER, FORCE = 2.5, 4.1
RAIL = keyboard().mechanism
DEPTHS = st.floats(0.0, 5e-3)
SPEEDS = st.floats(-1.0, 1.0)


def force(x: float, v: float, power: float = POWER) -> float:
    return rail_felt(x, v, RAIL.stop_stiffness, RAIL.stop_damping, power, FORCE)[0]


def test_at_its_force_it_is_as_stiff_and_as_lossy_as_the_rail() -> None:
    x = FORCE / RAIL.stop_stiffness
    assert force(x, 0.0) == pytest.approx(FORCE)
    assert force(x, 0.3) == pytest.approx(FORCE + RAIL.stop_damping * 0.3)
    assert force(x / 2, 0.0) < FORCE / 2, "softer before"
    assert force(1.5 * x, 0.0) > 1.5 * FORCE, "and harder beyond"


@given(x=DEPTHS, v=SPEEDS)
def test_it_never_pulls_and_its_tangents_are_those_of_its_force(x: float, v: float) -> None:
    f, slope, drag = rail_felt(x, v, RAIL.stop_stiffness, RAIL.stop_damping, POWER, FORCE)
    assert f >= 0.0
    assert force(0.0, v) == 0.0, "no jump at touch"
    if f > 1e-6 and x > 1e-5:
        assert slope == pytest.approx((force(x + 1e-9, v) - force(x - 1e-9, v)) / 2e-9, rel=1e-4)
        assert drag == pytest.approx((force(x, v + 1e-6) - force(x, v - 1e-6)) / 2e-6, rel=1e-4)


def test_a_loop_loses_work() -> None:
    t = np.linspace(0.0, 2 * np.pi, 2001)
    x, v = 1e-3 * (1 - np.cos(t)), 0.1 * np.sin(t)
    loop = np.array([force(float(a), float(b)) for a, b in zip(x, v, strict=True)])
    assert np.trapezoid(loop * v, t) > 0.05 * np.trapezoid(loop * np.maximum(v, 0.0), t)


@given(x=DEPTHS, v=SPEEDS, power=st.floats(1.1, 4.0))
def test_the_plant_has_the_same_law_about_the_hinge(x: float, v: float, power: float) -> None:
    r = RAIL.reference_radius
    torque, stiffness, damping = stop_felt(
        x / r, v / r, RAIL.stop_stiffness * r**2, RAIL.stop_damping * r**2, power, FORCE * r
    )
    ours = rail_felt(x, v, RAIL.stop_stiffness, RAIL.stop_damping, power, FORCE)
    np.testing.assert_allclose((torque / r, stiffness / r**2, damping / r**2), ours, rtol=1e-9)
