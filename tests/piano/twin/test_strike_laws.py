"""The laws of the reduced strike model by themselves: their limits, where they become another
author's law, and what they give back of what they took.
"""

from __future__ import annotations

import math

import numpy as np
import one_strike
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pianobot_ros.piano.twin.reduced.strike_laws import (
    LET_OFF_SPEED,
    dahl_advance,
    friction_advance,
    let_off,
    preload,
    relaxed,
)

STEP = 1e-4  # s


def held_at(rate: float, breakaway: float, creep: float, seconds: float) -> float:
    """Friction's state after moving at a constant rate."""
    z = 0.0
    for _ in range(round(seconds / STEP)):
        z = friction_advance(z, rate * STEP, breakaway, creep, STEP)
    return z


@given(st.floats(-1, 1), st.floats(-0.05, 0.05), st.floats(1e-4, 0.03), st.floats(1e-5, 1e-2))
def test_friction_without_creep_is_dahls(z: float, dx: float, breakaway: float, h: float) -> None:
    assert friction_advance(z, dx, breakaway, 0.0, h) == dahl_advance(z, dx, breakaway)


@pytest.mark.parametrize("creep", [10.0, 50.0])
def test_friction_that_creeps_grows_with_the_speed_and_holds_nothing(creep: float) -> None:
    """Slow against breakaway times creep it is a damper, as regularised Coulomb friction is; fast
    it is whole; at rest it fades.
    """
    breakaway = 0.003
    slow = 0.01 * breakaway * creep
    assert held_at(slow, breakaway, creep, 20.0 / creep) == pytest.approx(0.01, rel=0.05)
    assert held_at(100.0 * breakaway * creep, breakaway, creep, 1.0) == pytest.approx(1.0, abs=0.02)
    z = friction_advance(1.0, 0.0, breakaway, creep, 1.0 / creep)
    assert z == pytest.approx(math.exp(-1.0))


@pytest.mark.parametrize("back", [-1.0, 0.0, 0.33, 1.0])
def test_let_off_gives_back_on_the_way_up_what_is_not_dry(back: float) -> None:
    angles = np.linspace(0.02, 0.044, 400)
    fast = 50.0 * LET_OFF_SPEED

    def work(rate: float) -> float:
        torque = [sum(let_off(a, rate, 0.05, 0.032, 0.003, back)[:2]) for a in angles]
        return float(np.trapezoid(torque, angles))

    assert work(-fast) == pytest.approx(back * work(fast), abs=1e-3 * work(fast))


def test_let_off_widens_without_growing() -> None:
    narrow, wide, top = (
        sum(let_off(angle, 1.0, 0.05, 0.03, width, 0.33)[:2])
        for angle, width in ((0.034, 0.0025), (0.034, 0.006), (0.03, 0.006))
    )
    assert narrow < wide < top == pytest.approx(0.05)


@given(st.floats(-0.5, 0.5), st.floats(-1, 1))
def test_let_offs_dry_part_is_against_the_motion_and_its_slope_is_its_derivative(
    rate: float, back: float
) -> None:
    def dry(w: float) -> float:
        return let_off(0.032, w, 0.05, 0.032, 0.003, back)[1]

    slope = let_off(0.032, rate, 0.05, 0.032, 0.003, back)[2]
    assert dry(rate) * rate >= 0.0
    assert slope == pytest.approx((dry(rate + 1e-6) - dry(rate - 1e-6)) / 2e-6, abs=1e-6)


@given(st.floats(1e-5, 1e-2), st.floats(0.02, 5.0), st.floats(1.0, 30.0))
def test_creep_of_two_branches_is_one_where_they_do_not_spread(
    h: float, time: float, spread: float
) -> None:
    once, twice = relaxed(h, time, 1.0)
    quick, slow = relaxed(h, time, spread)
    assert once == twice == pytest.approx(1.0 - math.exp(-h / time), rel=1e-6)
    assert quick >= once >= slow > 0.0


def test_a_preload_fades_with_the_angle_or_not_at_all() -> None:
    assert preload(0.03, 0.02, 0.0) == 0.02
    assert preload(0.03, 0.02, 100.0) == pytest.approx(0.02 * math.exp(-3.0))
    assert preload(-0.01, 0.02, 100.0) == 0.02


def test_a_linked_hammer_stays_with_its_key_and_a_free_one_flies() -> None:
    """A mass that is linked is felt on the way up as well: the key comes back later."""
    model, motion = one_strike.given(speed=0.3)
    rises = []
    for captive in (0.0, 1.0):
        stroke = model.strike(
            motion, {"hammer": 0.03, "hammer_weight": 0.0, "hammer_captive": captive}
        )
        down = np.flatnonzero(stroke.angle > 0.5 * model.key.max_angle)
        rises.append(stroke.time[down[-1]])
    assert rises[1] > rises[0] + 1e-3
