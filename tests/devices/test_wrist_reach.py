"""What the arm is given in one of the controller's cycles, whatever came in it, and when the
driver's process, or its stream, was held up.
"""

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
NOTICED = 1e-4  # s after which a cycle's package is noticed
OWN = 20.0  # m/s², largest acceleration of the stream below


def way(t: float) -> list[float]:
    """A strike and a travel: up to 0.75 m/s and 19 m/s²."""
    return [0.03 * math.sin(25.0 * t), 0.3, 0.2 + 0.01 * math.sin(20.0 * t), *DOWN]


def played(times: list[float]) -> tuple[np.ndarray, list[float]]:
    """Poses given at these times, of a stream that had a setpoint each 8 ms; what came while nobody
    looked is left out. And how far behind the arm was.
    """
    reach, out, lags, seen = Reach(LIMITS, PERIOD), [], [], 0
    reach.rest(way(0.0))
    for now in times:
        while seen * PERIOD <= now + 1e-9:
            reach.ask(way(seen * PERIOD), seen * PERIOD)
            seen += 1
        out.append(reach.give(now, now // PERIOD * PERIOD))
        lags.append(reach.lag)
    return np.array(out), lags


def test_a_stream_that_nothing_holds_up_passes_unchanged() -> None:
    times = [k * PERIOD + NOTICED for k in range(200)]
    given_, lags = played(times)
    expected = np.array([way(k * PERIOD) for k in range(200)])
    # it begins at full speed, which the arm has to come to
    assert given_[20:] == pytest.approx(expected[20:], abs=1e-12)
    assert max(lags[20:]) == 0.0


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
    times = [k * PERIOD + NOTICED + phase for k in cycles]
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


@st.composite
def courses(draw: st.DrawFn) -> tuple[float, list[tuple[float, bool, list[float] | None]]]:
    """A controller's period, and in order of time: when it takes over what it was given last
    (True), and when a pose is asked for (or None: it is looked for what is short). Two streams, of
    which one turns the hand, say where to go.
    """
    period = draw(st.sampled_from([0.002, PERIOD]))
    late = draw(st.lists(st.floats(0.0, 0.9), min_size=12, max_size=40))  # of a controller, cycles
    fast, slow = draw(st.floats(0.5, 3.0)), draw(st.floats(-0.5, 0.5))  # m/s
    poses = {
        "straight": lambda when: [fast * when, 0.3, 0.2, *DOWN],
        "turning": lambda when: [slow * when, 0.3, 0.2, math.pi - 2.0 * when, 0.0, 0.0],
        "nothing": lambda when: None,
    }
    kinds = st.sampled_from(["straight", "straight", "straight", "turning", "nothing"])
    events: list[tuple[float, bool, list[float] | None]] = []
    for k, by in enumerate(late):
        events.append(((k + by) * period, True, None))
        for when in draw(st.lists(st.floats(0.0, 1.0), max_size=3)):
            at = (k + when) * period
            events.append((at, False, poses[draw(kinds)](at)))
    return period, sorted(events, key=lambda event: event[0])


@given(courses())
def test_whatever_falls_into_a_cycle_moves_the_arm_as_far_as_one_cycle_allows(
    course: tuple[float, list[tuple[float, bool, list[float] | None]]],
) -> None:
    """The controller obeys what it was given last in each of its cycles, be it none, one, or some,
    and be it late itself.
    """
    period, events = course
    reach, place = Reach(LIMITS, period), [0.0, 0.3, 0.2, *DOWN]
    reach.rest(place)
    reach.ask(place, 0.0)
    last, cycle, taken = place, -math.inf, 0
    for when, takes_over, pose in events:
        if not takes_over:
            if pose is not None:
                reach.ask(pose, when)
            last = reach.give(when, cycle)
            continue
        step = math.dist(last[:3], place[:3]) / period
        swing = abs(last[3] - place[3]) % (2.0 * math.pi)
        swing = min(swing, 2.0 * math.pi - swing) / period
        assert step < 1.03 * LIMITS.speed and swing < 1.03 * LIMITS.angular_speed
        place, cycle, taken = last, taken * period + NOTICED, taken + 1


@pytest.mark.parametrize("period", [0.002, PERIOD])
@pytest.mark.parametrize("phase", [0.0, 0.0003, 0.5 * PERIOD, PERIOD - 0.0003])
def test_setpoints_that_fall_into_cycles_unevenly_are_followed_evenly(
    period: float, phase: float
) -> None:
    """Two in one cycle and none in the next, or one in four: what the arm is short of follows."""
    reach, speed, steps, k = Reach(LIMITS, period), 0.8 * LIMITS.speed, [], 0
    reach.rest([0.0, 0.3, 0.2, *DOWN])
    last = before = [0.0]
    for cycle in range(round(0.4 / period)):
        begin = cycle * period + NOTICED
        if k and reach.short:
            last = reach.give(begin, begin)
        while (due := k * PERIOD + phase + (0.3 * PERIOD if k % 2 else 0.0)) < begin + period:
            reach.ask([speed * due - 0.1, 0.3, 0.2, *DOWN], due)
            last, k = reach.give(due, begin), k + 1
        steps.append((last[0] - before[0]) / period)
        before = last
    assert max(map(abs, steps)) < 1.03 * LIMITS.speed
    assert np.mean(steps[len(steps) // 2 :]) == pytest.approx(speed, rel=0.1)


def test_a_turn_is_caught_up_with_within_its_own_limits() -> None:
    reach = Reach(LIMITS, PERIOD)
    reach.rest([0.0, 0.3, 0.2, *DOWN])
    aside = [0.0, 0.3, 0.2, math.pi - 0.4, 0.0, 0.0]
    angles = [math.pi]
    for k in range(200):
        reach.ask(aside, k * PERIOD)
        angles.append(reach.give(k * PERIOD, k * PERIOD)[3])
    rates = np.diff(angles) / PERIOD
    assert np.abs(rates).max() < 1.03 * LIMITS.angular_speed
    assert np.abs(np.diff(rates)).max() / PERIOD < 1.1 * LIMITS.angular_acceleration
    assert angles[-1] == pytest.approx(math.pi - 0.4)
