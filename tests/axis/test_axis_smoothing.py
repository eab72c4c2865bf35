"""Smoothing that follows from what the effort tells of the acceleration; pushes from outside."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from pianobot_ros.axis.commissioning.regression import regress
from pianobot_ros.axis.log import Log
from pianobot_ros.axis.signals.cleaning import HIGHEST, clean, effort_noise
from pianobot_ros.axis.signals.segment import blocks_of
from pianobot_ros.axis.twin.description import HORIZON, drowned
from pianobot_ros.axis.twin.servo_axis import ServoAxis

RATE, INERTIA, GRAVITY, FRICTION, VISCOUS = 200.0, 0.17, 3.4, 0.1, 0.02
TORQUE = 0.9
"""Nm; far less than gravity, so that the joint swings and inertia and gravity balance."""
PUSH = (14.0, 14.2)
"""s."""


@njit(cache=True)
def swing(seconds, torque, push):
    """Position and effort (n, 2) of a pendulum that is pumped up, and braked where it is high."""
    n = int(seconds * RATE)
    out = np.empty((n, 2))
    h = 1.0 / RATE / 20
    q, v = 0.3, 0.0
    for i in range(n):
        height = 0.5 * INERTIA * v * v + GRAVITY * (1.0 - np.cos(q))
        effort = torque * np.tanh(5.0 * v) * (1.0 if height < 1.4 * GRAVITY else -0.6)
        out[i, 0], out[i, 1] = q, effort
        outside = push if PUSH[0] < i / RATE < PUSH[1] else 0.0
        for _ in range(20):
            free = v + h * (effort + outside - GRAVITY * np.sin(q) - VISCOUS * v) / INERTIA
            brake = h * FRICTION / INERTIA
            v = np.sign(free) * max(abs(free) - brake, 0.0)
            q += h * v
    return out


def log_of(*, shake=0.0, push=0.0):
    """A log whose encoder errs by `shake` (rad) at 15 to 40 Hz."""
    made = swing(20.0, TORQUE, push)
    rng = np.random.default_rng(3)
    t = np.arange(len(made)) / RATE
    waves = [np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in np.linspace(15, 40, 30)]
    position = made[:, 0] + shake * np.sum(waves, axis=0) / np.sqrt(15.0)
    effort = made[:, 1] + 0.01 * rng.standard_normal(t.size)
    return Log("swing", t, None, position, None, effort, "Nm")


def test_inertia_and_gravity_survive_an_encoder_that_shakes():
    fixed = regress([clean(log_of(shake=3e-3), HIGHEST)])
    assert fixed["inertia"] < 0.5 * INERTIA
    found = regress([clean(log_of(shake=3e-3))])
    assert found["inertia"] == pytest.approx(INERTIA, rel=0.1)
    assert found["gravity"] == pytest.approx(GRAVITY, rel=0.1)


def test_a_clean_log_is_smoothed_no_further():
    assert clean(log_of()).cutoff == HIGHEST


def test_a_push_from_outside_is_left_out_and_said():
    cleaned = clean(log_of(push=12.0))
    lost = cleaned.t[~cleaned.valid]
    assert PUSH[0] - 0.2 < lost.min() and lost.max() < PUSH[1] + 0.2
    assert any("something outside pushed" in n for n in cleaned.log.notes)
    found = regress([cleaned])
    assert found["inertia"] == pytest.approx(INERTIA, rel=0.1)
    assert found["gravity"] == pytest.approx(GRAVITY, rel=0.1)


def test_no_push_is_invented():
    assert clean(log_of()).valid.all()
    assert clean(log_of(push=0.3)).valid.all()  # no more than the motor does


def test_what_moves_before_the_first_and_after_the_last_rest_is_kept():
    t = np.arange(0, 24, 0.01)
    moving = np.sin(2 * t) * np.ones(t.size)
    phase = t % 6.0
    held = np.where((phase > 3.0) & (phase < 4.0), 0.0, 1.0)
    command = np.cumsum(0.01 * moving * held)
    blocks, how = blocks_of(clean(Log("moves", t, command, command, None, None)))
    assert "moves between rests" in how
    assert min(b.outputs["position"].t[0] for b in blocks) < 0.3
    assert max(b.outputs["position"].t[-1] for b in blocks) > t[-1] - 0.3


def test_where_no_motion_is_repeated_free_motion_has_the_noise_of_efforts_for_a_floor():
    """As wide as that noise makes the position at the end of many horizons, on average over them;
    repeats would show it in their scatter.
    """
    t = np.arange(0.0, 20.0, 1.0 / RATE)
    q, v, a = (x * np.array([0.8, 0.5]) for x in (1.0, np.array([2.0, 5.0]), np.array([4.0, 25.0])))
    waves = np.array([2.0 * t, 5.0 * t])
    position, speed, rise = q @ np.sin(waves), v @ np.cos(waves), -a @ np.sin(waves)
    noise = 0.01 * np.random.default_rng(0).standard_normal(t.size)
    effort = INERTIA * rise + VISCOUS * speed + GRAVITY * np.sin(position) + noise
    held = clean(Log("waves", t, None, position, None, effort, "Nm"))
    density = effort_noise([held])
    assert density == pytest.approx(0.01 / np.sqrt(RATE), rel=0.15)
    once, often = (ServoAxis([held], repeated=r) for r in (False, True))
    h, steps = HORIZON / 400, 400
    noise = np.random.default_rng(1).standard_normal((2000, steps)) * density / np.sqrt(h)
    away = np.cumsum(np.cumsum(noise / once.joint.nominal["inertia"], axis=1), axis=1) * h**2
    tolerance = {o.name: o.tolerance for o in once.observables}["free motion"]
    without = {o.name: o.tolerance for o in often.observables}["free motion"]
    assert tolerance**2 - without**2 == pytest.approx(float(np.mean(away**2)), rel=0.1)


@pytest.mark.long
def test_an_effort_that_is_mostly_noise_predicts_no_motion():
    t = np.arange(0.0, 20.0, 1.0 / RATE)
    position = 0.1 * np.sin(2.0 * t)
    pull = INERTIA * np.gradient(np.gradient(position, t), t)
    noise = np.random.default_rng(0).standard_normal(t.size)
    said = []
    for size in (0.1, 30.0):
        effort = pull + size * float(np.std(pull)) * noise
        held = clean(Log("faint", t, position, position, None, effort, "Nm"))
        twin = ServoAxis([held], {"inertia": INERTIA})
        said.append((drowned(twin.joint), "free motion" in [o.name for o in twin.observables]))
    assert said == [(False, True), (True, False)]


def test_in_a_noisy_sine_inertia_is_no_gravity():
    """Both go with the angle there, and the angle is measured better."""
    t = np.arange(0.0, 40.0, 1.0 / RATE)
    angle = 0.1 * np.sin(2.5 * t)
    speed, rise = 0.25 * np.cos(2.5 * t), -0.625 * np.sin(2.5 * t)
    rng = np.random.default_rng(0)
    position = angle + 7e-5 * rng.standard_normal(t.size)
    effort = INERTIA * rise + 0.9 * speed + 0.05 * rng.standard_normal(t.size)
    found = regress([clean(Log("sine", t, None, position, None, effort, "Nm"), HIGHEST)])
    assert found["inertia"] == pytest.approx(INERTIA, rel=0.2)
