"""What the arm is given when the driver's process, or its stream, was held up."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pianobot_ros.devices.wrist.config import UrConfig
from pianobot_ros.devices.wrist.limits.reach import Reach

PERIOD = 0.008
LIMITS = UrConfig.load().limits
DOWN = (math.pi, 0.0, 0.0)
OWN = 20.0  # m/s², largest acceleration of the stream below


def way(t: float) -> list[float]:
    """A strike and a travel: up to 0.75 m/s and 19 m/s²."""
    return [0.03 * math.sin(25.0 * t), 0.3, 0.2 + 0.01 * math.sin(20.0 * t), *DOWN]


def played(times: list[float], late: float = 0.0) -> tuple[np.ndarray, list[float]]:
    """Poses given at these times, of a stream that had a setpoint each 8 ms; what came while nobody
    looked is left out. And how far behind the arm was.
    """
    reach, out, lags, seen = Reach(LIMITS, PERIOD), [], [], 0
    reach.rest(way(0.0), 0.0)
    for now in times:
        while seen * PERIOD <= now - late + 1e-9:
            reach.ask(way(seen * PERIOD), seen * PERIOD)
            seen += 1
        out.append(reach.give(now))
        lags.append(reach.lag)
    return np.array(out), lags


def test_a_stream_that_nothing_holds_up_passes_unchanged() -> None:
    times = [k * PERIOD for k in range(200)]
    given_, lags = played(times)
    assert given_[3:] == pytest.approx(np.array([way(t) for t in times])[3:], abs=1e-12)
    assert max(lags[3:]) == 0.0


@given(
    st.lists(st.tuples(st.integers(5, 60), st.integers(2, 14)), min_size=1, max_size=4),
    st.floats(0.0, 0.004),
)
def test_after_any_holding_up_the_arm_keeps_the_limits_and_catches_up(
    holds: list[tuple[int, int]], phase: float
) -> None:
    cycles = list(range(400))
    begin = 0
    for after, lasting in holds:
        begin += after
        cycles = [k for k in cycles if not begin < k < begin + lasting]
        begin += lasting
    times = [k * PERIOD + phase for k in cycles]
    given_, lags = played(times)
    steps = np.linalg.norm(np.diff(given_[:, :3], axis=0), axis=1) / PERIOD
    assert steps.max() < 1.03 * LIMITS.speed
    together = np.array([b - a == 1 for a, b in pairwise(cycles)])
    both = together[1:] & together[:-1]
    change = np.linalg.norm(np.diff(given_[:, :3], 2, axis=0), axis=1) / PERIOD**2
    # in the cycle in which it has caught up, the stream's own comes on top
    assert change[both].max() < 1.02 * LIMITS.acceleration + OWN
    assert lags[-1] == 0.0
    assert given_[-1] == pytest.approx(way(399 * PERIOD), abs=1e-9)


@pytest.mark.parametrize("held", [3, 6, 9])
def test_two_setpoints_in_one_cycle_go_no_further_than_one(held: int) -> None:
    times = [k * PERIOD for k in range(40)]
    after = 39 * PERIOD + held * PERIOD
    times += [after, after + 0.0005, after + 0.001]
    given_, lags = played(times)
    assert np.linalg.norm(given_[-1, :3] - given_[39, :3]) < LIMITS.speed * (PERIOD + 0.002)
    assert max(lags[-3:]) > 0.0


def test_a_turn_is_caught_up_with_within_its_own_limits() -> None:
    reach = Reach(LIMITS, PERIOD)
    reach.rest([0.0, 0.3, 0.2, *DOWN], 0.0)
    aside = [0.0, 0.3, 0.2, math.pi - 0.4, 0.0, 0.0]
    angles = [math.pi]
    for k in range(200):
        reach.ask(aside, k * PERIOD)
        angles.append(reach.give(k * PERIOD)[3])
    rates = np.diff(angles) / PERIOD
    assert np.abs(rates).max() < 1.03 * LIMITS.angular_speed
    assert np.abs(np.diff(rates)).max() / PERIOD < 1.1 * LIMITS.angular_acceleration
    assert angles[-1] == pytest.approx(math.pi - 0.4)
