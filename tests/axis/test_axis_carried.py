"""A part that is picked up and put down amid the log."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from pianobot_ros.axis.commissioning.around.arm import coupling
from pianobot_ros.axis.commissioning.around.carried import carried
from pianobot_ros.axis.diagnosis.joint import diagnose_joint
from pianobot_ros.axis.log import Log
from pianobot_ros.axis.signals.cleaning import clean
from pianobot_ros.axis.twin.servo_axis import ServoAxis

RATE, SECONDS = 200.0, 30.0
INERTIA, VISCOUS = 0.4, 0.6  # kg m², Nm s/rad
MASS, REACH, HANGS = 0.8, 0.4, 0.3  # kg, m, rad
FROM, UNTIL = 9.3, 21.7  # s
PERIOD, RESTS = 8.0, (0.2, 0.9, -0.6, 0.4)  # s, rad
WAVES = ((0.5, 1.3), (0.3, 2.9), (0.1, 5.1))  # rad, rad/s


def picks(mass, seed=0):
    """Log of a joint that carries `mass` kg for a part of it; its motion is exactly known."""
    t = np.arange(0.0, SECONDS, 1.0 / RATE)
    q = np.sum([a * np.sin(w * t) for a, w in WAVES], axis=0)
    speed = np.sum([a * w * np.cos(w * t) for a, w in WAVES], axis=0)
    rise = np.sum([-a * w * w * np.sin(w * t) for a, w in WAVES], axis=0)
    held = (t > FROM) & (t < UNTIL)
    weight = mass * 9.81 * REACH * np.sin(q - HANGS) + mass * REACH**2 * rise
    rng = np.random.default_rng(seed)
    effort = INERTIA * rise + VISCOUS * speed + held * weight + 0.05 * rng.standard_normal(t.size)
    return Log("picks", t, None, q + 1e-5 * rng.standard_normal(t.size), None, effort, "Nm")


def test_the_span_and_the_load_are_found_by_regression():
    found = carried([clean(picks(MASS))], {})
    assert found["carried_load"] == pytest.approx(MASS * 9.81 * REACH, rel=0.15)
    assert found["carried_angle"] == pytest.approx(HANGS, abs=0.1)
    assert found["carried_reach"] == pytest.approx(REACH, rel=0.3)
    assert found["carried_from"] == pytest.approx(FROM, abs=SECONDS / 40)
    assert found["carried_until"] == pytest.approx(UNTIL, abs=SECONDS / 40)


def test_without_a_load_there_is_none_and_several_logs_are_not_asked():
    assert carried([clean(picks(0.0))], {}) == {}
    assert carried([clean(picks(MASS)), clean(picks(MASS, 1))], {}) == {}


def wanders(mass, turned=True, seconds=60.0, seed=2):
    """Log of an arm's second joint on a motion of five harmonics, whose gravity the third one turns
    if `turned`, and `mass` kg that it carries for a while.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 0.01)

    def motion(size):
        waves = 2 * np.pi / seconds * np.arange(1, 6)[:, None] * t
        of = rng.standard_normal((2, 5)) / np.arange(1, 6)
        y = of[0] @ np.sin(waves) + of[1] @ np.cos(waves)
        return size * y / np.abs(y).max()

    pan, q, elbow = motion(1.0), motion(1.3) - 1.0, motion(1.7)
    speed = np.gradient(q, t)
    rise = np.gradient(speed, t)
    held = mass * ((t > FROM) & (t < UNTIL))
    effort = 2 * rise + 1.2 * np.tanh(speed / 0.02) + 2 * speed - 7.6 * np.cos(q)
    effort += held * REACH * (9.81 * np.cos(q) + REACH * rise) - turned * 4.3 * np.cos(q + elbow)
    noise = np.array([1e-5, 0.15])[:, None] * rng.standard_normal((2, t.size))
    others = {"pan": pan, "elbow": elbow}
    names = ("pan", "lift", "elbow")
    made = Log("wanders", t, None, q + noise[0], None, effort + noise[1], "Nm", joint="lift")
    return replace(made, others=others, joints=names)


def test_what_other_joints_poses_explain_is_not_carried():
    assert carried([clean(wanders(0.0))], {}) == {}
    found = carried([clean(wanders(1.2))], {"elbow": 1.0})
    assert found["carried_from"] == pytest.approx(FROM, abs=1.6)
    assert found["carried_until"] == pytest.approx(UNTIL, abs=1.6)


def test_gravity_is_followed_where_one_of_its_two_parts_is_poorly_told():
    """The cosine of the sum hangs; its sine is nearly what the joint's own motion is."""
    c = clean(wanders(0.0, seconds=27.0, seed=4))
    assert coupling([c], "lift", c.log.joints) == {"elbow": 1.0}
    c = clean(wanders(0.0, turned=False, seconds=27.0, seed=4))
    assert coupling([c], "lift", c.log.joints) == {}


def test_gravity_that_another_joint_turns_is_not_taken_for_inertia():
    joint = ServoAxis([clean(wanders(0.0, seconds=27.0, seed=4))]).joint
    assert joint.others.arm == {"elbow": 1.0}
    assert joint.nominal["inertia"] == pytest.approx(2.0, rel=0.1)
    assert joint.nominal["viscous"] == pytest.approx(2.0, rel=0.2)


def cycles(mass):
    """Log of a joint that goes round four rests five times, and carries `mass` kg from the second
    to the third one; it follows its command closely.
    """
    t = np.arange(0.0, 5 * PERIOD, 1.0 / RATE)
    phase = np.mod(t, PERIOD)
    q = np.full(t.size, RESTS[0])
    for k, (a, b) in enumerate(pairwise((*RESTS, RESTS[0]))):
        x = np.clip(phase - 2.0 * k - 1.0, 0.0, 1.0)
        q = q + (b - a) * x**3 * (10.0 - 15.0 * x + 6.0 * x * x)
    speed = np.gradient(q, t)
    rise = np.gradient(speed, t)
    held = (phase > 2.6) & (phase < 4.4)
    weight = mass * 9.81 * REACH * np.sin(q - HANGS) + mass * REACH**2 * rise
    rng = np.random.default_rng(3)
    noise = rng.standard_normal((2, t.size))
    effort = INERTIA * rise + VISCOUS * speed + held * weight + 0.05 * noise[0]
    command = q + 0.02 * speed
    return Log("cycles", t, command, q + 1e-5 * noise[1], None, effort, "Nm")


def test_a_load_of_each_cycle_is_found_where_the_joint_rests():
    found = carried([clean(cycles(MASS))], {})
    assert found["carried_period"] == pytest.approx(PERIOD, rel=0.01)
    assert found["carried_from"] == pytest.approx(2.5, abs=0.1)
    assert found["carried_until"] == pytest.approx(4.5, abs=0.1)
    assert found["carried_load"] == pytest.approx(MASS * 9.81 * REACH, rel=0.2)
    assert carried([clean(cycles(0.0))], {}) == {}


@pytest.mark.slow
@pytest.mark.long
def test_a_load_of_each_cycle_is_named():
    found = diagnose_joint([cycles(MASS)], budget=8000).diagnosis
    values = {n: p.value for e in found.effects for n, p in e.parameters.items()}
    assert "carried_load" in {e.name for e in found.effects}
    assert values["carried_from"] == pytest.approx(2.6, abs=0.15)
    assert values["carried_until"] == pytest.approx(4.4, abs=0.15)


@pytest.mark.slow
@pytest.mark.long
def test_it_is_named_with_its_size_and_time():
    found = diagnose_joint([picks(MASS)], budget=8000).diagnosis
    (effect,) = found.effects
    assert effect.name == "carried_load"
    values = {n: p.value for n, p in effect.parameters.items()}
    assert values["carried_load"] == pytest.approx(MASS * 9.81 * REACH, rel=0.05)
    assert values["carried_reach"] == pytest.approx(REACH, rel=0.1)
    assert values["carried_from"] == pytest.approx(FROM, abs=0.1)
    assert values["carried_until"] == pytest.approx(UNTIL, abs=0.1)
