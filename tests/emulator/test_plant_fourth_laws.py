"""The plant's law 3 of some effects, by what its sources promise. Kernels run uncompiled here."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pianobot_ros.cell.arrays import Array
from pianobot_ros.emulator.plant.laws import air, arm, contact, hand, key, sensing
from pianobot_ros.emulator.plant.laws.row_layout import FINGER_STATE, HAMMER, KEY_STATE

STEP = 1e-3
TIME = STEP * np.arange(1, 4001)
ANGLE = 0.02 * np.sin(2 * math.pi * TIME) + 0.013 * np.sin(10 * math.pi * TIME)  # closes on itself

Law = Callable[[float, float], float]


def plain(kernel: Any) -> Any:
    return kernel.py_func


def row() -> Array:
    return np.zeros((1, FINGER_STATE))


def cycles(torque: Law) -> tuple[float, float]:
    """Work (N m) that goes into ``torque(angle, rate)`` over whole cycles, and its amplitude times
    the angle's.
    """
    rates = np.gradient(ANGLE, STEP)
    torques = np.array([torque(float(x), float(v)) for x, v in zip(ANGLE, rates, strict=True)])
    settled = len(TIME) // 4  # a cycle of the slow motion
    work = STEP * torques[settled:] @ rates[settled:]
    return float(work), float(np.ptp(torques) * np.ptp(ANGLE))


def friction() -> Law:
    fs = row()
    return lambda x, rate: plain(hand.maxwell_slip)(fs, 0, 0, 0.01, rate, STEP)[0]


def grains() -> Law:
    fs = row()
    return lambda x, rate: plain(hand.jammed_soil)(fs, 0, 0, STEP * rate)


def creep() -> Law:
    crept = [0.0]

    def law(x: float, rate: float) -> float:
        crept[0] = plain(hand.eyring_creep)(crept[0], 0.3 * x, 0.3, STEP)
        return x - crept[0]

    return law


def play() -> Law:
    fs = row()

    def law(x: float, rate: float) -> float:
        twist, twisting, _ = plain(hand.gear_play)(fs, 0, 0, x, rate, 0.005, 0.002, STEP)
        return float(twist + 0.002 * twisting)

    return law


@pytest.mark.parametrize("law", [friction, grains, creep, play])
def test_closed_motions_take_work_and_give_none(law: Callable[[], Law]) -> None:
    work, scale = cycles(law())
    assert 0.005 * scale < work < 10 * scale


def test_play_carries_nothing_inside_and_never_pulls() -> None:
    fs = row()
    for x, rate in zip(ANGLE, np.gradient(ANGLE, STEP), strict=True):
        twist, twisting, flank = plain(hand.gear_play)(
            fs, 0, 0, float(x), float(rate), 0.005, 0.002, STEP
        )
        torque, at = twist + 0.002 * twisting, x - twist
        assert torque * at >= 0.0 if flank else torque == pytest.approx(0.0, abs=1e-12)


def test_low_pass_trails_a_ramp_by_its_time() -> None:
    lag = np.full((2, 1), 0.4)
    for n in range(2000):
        out = plain(arm.second_order)(lag, 0, 0.4 + 0.1 * STEP * n, STEP, 0.05)
    # a target that is held over each step is itself half a step late
    assert 0.4 + 0.1 * STEP * 2000 - out == pytest.approx(0.1 * (0.05 + STEP / 2), rel=1e-6)


def test_waits_of_a_queue_have_their_mean() -> None:
    chances = (np.arange(20_000) + 0.5) / 20_000
    waits = [plain(arm.queued)(0.01, float(chance)) for chance in chances]
    assert np.mean(waits) == pytest.approx(0.01, rel=1e-3)
    assert min(waits) >= 0.006


def test_springs_in_the_joints_store_work_whatever_the_force() -> None:
    matrix = np.array(
        [[plain(arm.joint_give)(unit, c, 1e-5) for unit in np.eye(3)] for c in range(3)]
    )
    assert np.allclose(matrix, matrix.T)
    assert np.all(np.linalg.eigvalsh(matrix) > 0)
    assert matrix[2, 2] == 1e-5 and matrix[1, 2] > 0


def test_relays_are_right_at_both_ends_and_off_by_their_half_between() -> None:
    plays = np.array(air.RELAYS)
    told = [-50e3, -100e3, -50e3, 0.0]
    found = [plain(air.relay_loop)(plays, aim, 800.0) for aim in told]
    assert found == pytest.approx([-49.2e3, -100e3, -50.8e3, 0.0], abs=10.0)


def test_air_enters_a_choked_hole_as_fast_as_it_can() -> None:
    assert [plain(air.choked_leak)(p, 300.0) for p in (0.0, -60e3, -100e3)] == [0.0, 300.0, 300.0]
    assert 0.0 < plain(air.choked_leak)(-20e3, 300.0) < 300.0


def test_soft_finger_gives_what_is_named_at_five_newtons() -> None:
    force, share = plain(contact.soft_finger_in_series)(4000.0, 5.0 / 4000.0 + 3e-4, 3e-4)
    assert force == pytest.approx(5.0)
    more, _ = plain(contact.soft_finger_in_series)(4000.0, 5.0 / 4000.0 + 3e-4 + 1e-8, 3e-4)
    assert (more - force) / 1e-8 == pytest.approx(4000.0 * share, rel=1e-4)


def test_a_held_key_bears_the_weight_of_its_lever() -> None:
    ks = np.zeros((1, KEY_STATE))
    for _ in range(20_000):
        torque = plain(key.slotted_hammer)(ks, 0, 1e-3, 0.03, 0.0, 5e-5)
    assert torque == pytest.approx(-25.0 * 1e-3, rel=1e-3)
    assert ks[0, HAMMER] < 0.03


def test_hyperbolic_tangent_loses_what_is_named_at_five_newtons() -> None:
    for loss in (1e-4, 0.01, 0.5):
        bend = plain(sensing.tanh_scale)(loss)
        assert bend * math.tanh(5.0 / bend) == pytest.approx(5.0 * (1.0 - loss), rel=1e-9)


def test_sensor_is_right_as_the_force_rises_and_above_as_it_falls() -> None:
    memory = np.zeros(10)
    rise = [plain(sensing.two_way_gain)(memory, f, 0.1) for f in (0.0, 1.0, 4.0)]
    fall = [plain(sensing.two_way_gain)(memory, f, 0.1) for f in (2.0, 0.0)]
    assert rise == [0.0, 1.0, 4.0] and fall == pytest.approx([2.4, 0.0])
