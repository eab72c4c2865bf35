"""Setpoints ahead of their time: what the arm is given in each cycle, whatever the jitter with
which they came.
"""

from __future__ import annotations

import math
import socket

import numpy as np
import pytest

from pianobot_ros.devices.wrist.config import UrConfig
from pianobot_ros.devices.wrist.messages import Setpoint
from pianobot_ros.devices.wrist.rtde.setpoint_stream import CycleClock, SetpointStream
from pianobot_ros.devices.wrist.rtde.worker import Worker

PERIOD = 0.008


def height(t: float) -> float:
    return 0.2 + 0.01 * math.sin(2 * math.pi * t / 0.25)  # 0.25 m/s at most, as in a strike


def setpoint(k: int, rotation: tuple[float, float, float] = (math.pi, 0.0, 0.0)) -> Setpoint:
    t = k * PERIOD
    return Setpoint(k, t - 0.05, t, [0.1, 0.3, height(t), *rotation])


def filled(count: int) -> SetpointStream:
    stream = SetpointStream()
    for k in range(count):
        stream.add(setpoint(k))
    return stream


@pytest.mark.parametrize("phase", [0.0, 0.003, 0.0079])
def test_between_setpoints_it_follows_the_motion(phase: float) -> None:
    stream = filled(60)
    for cycle in range(2, 55):
        t = cycle * PERIOD + phase
        got = stream.at(t)
        assert got is not None and got.pose[2] == pytest.approx(height(t), abs=2e-5)


def test_before_the_first_there_is_nothing_and_after_the_last_it_holds() -> None:
    stream = filled(10)
    assert stream.at(-0.001) is None
    last = stream.at(stream.end + 1.0)
    assert last is not None and last.pose[2] == height(9 * PERIOD) and last.sequence == 9
    stream.clear()
    assert not stream and stream.end == -math.inf and stream.at(0.0) is None


def test_a_setpoint_replaces_those_that_were_to_come_later() -> None:
    stream = filled(20)
    stream.add(Setpoint(99, 0.0, 5 * PERIOD, [0.1, 0.3, 0.5, math.pi, 0.0, 0.0]))
    assert stream.end == 5 * PERIOD
    got = stream.at(0.2)
    assert got is not None and got.sequence == 99


def test_a_hole_in_the_stream_is_waited_out_not_bridged() -> None:
    stream = filled(3)
    stream.add(setpoint(50))
    held = stream.at(20 * PERIOD)
    assert held is not None and held.pose[2] == height(2 * PERIOD)


def test_a_rotation_vector_that_flips_its_sign_is_the_same_rotation() -> None:
    stream = SetpointStream()
    near, turned = (
        (math.pi - 0.01, 0.0, 0.0),
        (-(math.pi - 0.01), 0.0, 0.0),
    )  # 0.02 rad apart, across half a turn
    stream.add(setpoint(0, near))
    stream.add(setpoint(1, turned))
    got = stream.at(0.5 * PERIOD)
    assert got is not None and got.pose[3:] == pytest.approx([math.pi, 0.0, 0.0], abs=1e-9)


def test_the_clock_ignores_lateness_and_follows_drift_and_jumps() -> None:
    clock, random = CycleClock(), np.random.default_rng(1)
    read = [
        clock.read(100.0 + k * PERIOD * (1 + 2e-5) + random.exponential(4e-4), k * PERIOD)
        for k in range(5000)
    ]
    true = 100.0 + np.arange(5000) * PERIOD * (1 + 2e-5)
    assert np.abs(np.array(read) - true)[100:].max() < 4e-4
    assert np.diff(read).min() > 0.0
    # One package far too late moves nothing; a controller that skipped cycles is followed.
    assert clock.read(true[-1] + PERIOD + 0.1, 5000 * PERIOD) == pytest.approx(
        true[-1] + PERIOD, abs=1e-3
    )
    late = [clock.read(true[-1] + 0.25 + k * PERIOD, (5000 + k) * PERIOD) for k in range(2, 100)]
    assert late[-1] == pytest.approx(true[-1] + 0.25 + 99 * PERIOD, abs=1e-6)


def steps(stream: SetpointStream, cycles: list[int]) -> list[float]:
    """Heights given in these cycles."""
    found = [stream.follow(cycle * PERIOD, PERIOD) for cycle in cycles]
    return [f.pose[2] for f in found if f is not None]


def test_who_was_held_up_catches_up_along_the_path() -> None:
    """A step to where the arm should be by now is faster than any joint can go."""
    kept, held = filled(100), filled(100)
    usual = np.abs(np.diff(steps(kept, list(range(80))))).max()
    given = steps(held, [*range(20)])
    assert kept.behind == held.behind == 0.0
    given += steps(held, [32])  # twelve cycles missed
    assert held.behind == pytest.approx(11.5 * PERIOD)
    given += steps(held, [*range(33, 80)])
    assert held.behind == 0.0
    assert np.abs(np.diff(given)).max() < 1.6 * usual
    late = [steps(filled(100), [cycle])[0] for cycle in range(32 + 24 + 1, 80)]
    assert given[-len(late) :] == pytest.approx(late, abs=1e-9), "and then it is where it should be"


def test_setpoints_that_came_late_are_caught_up_with() -> None:
    stream = filled(20)
    given = steps(stream, list(range(32)))
    for k in range(20, 100):
        stream.add(setpoint(k))
    assert stream.behind == 0.0, "there is nothing yet that it could be behind"
    given += steps(stream, [32])
    assert stream.behind > 10 * PERIOD
    given += steps(stream, list(range(33, 80)))
    assert stream.behind == 0.0
    usual = np.abs(np.diff([height(k * PERIOD) for k in range(80)])).max()
    assert np.abs(np.diff(given)).max() < 1.6 * usual
    assert given[-1] == pytest.approx(height(79 * PERIOD), abs=2e-5)


def test_a_hole_is_not_caught_up_with() -> None:
    stream = filled(3)
    for k in range(50, 60):
        stream.add(setpoint(k))
    given = steps(stream, list(range(59)))
    assert stream.behind == 0.0
    assert given[49] == height(2 * PERIOD)
    assert given[50:59] == pytest.approx([height(k * PERIOD) for k in range(50, 59)], abs=2e-5)


def test_a_stream_that_is_ahead_is_not_stale_when_the_controller_is_late() -> None:
    """The arm was stopped in mid-strike for a package that came 10 ms late, with the strike's
    setpoints waiting, and was given the way that it had missed in one step.
    """
    ours, theirs = socket.socketpair()
    config = UrConfig.load()
    with ours, theirs:
        worker = Worker(theirs, config, starts_program=False)
        worker._heard = 1.0
        assert worker._stale_at() == pytest.approx(1.0 + config.limits.stale)
        worker._stream = filled(140)
        assert worker._stale_at() == pytest.approx(139 * PERIOD + config.limits.stale)
        worker._stream.clear()
        assert worker._stale_at() == pytest.approx(1.0 + config.limits.stale)
