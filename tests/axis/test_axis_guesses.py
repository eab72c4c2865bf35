"""Friction and gravity together, which hide each other from a search one by one; rests."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pianobot_ros.axis.commissioning.regression import finest, rippling, waves
from pianobot_ros.axis.diagnosis.joint import diagnose_joint
from pianobot_ros.axis.log import Log
from pianobot_ros.axis.signals.cleaning import clean
from pianobot_ros.axis.twin.servo_axis import ServoAxis

INERTIA, COULOMB, VISCOUS, GRAVITY = 0.3, 1.2, 0.8, 2.0
RATE, FINE = 100, 5


def arm(seconds=30.0, seed=1) -> Log:
    """A joint with gravity and dry friction that moves between rests; its controller knows the
    gravity.
    """
    rng = np.random.default_rng(seed)
    n = int(seconds * RATE)
    t = np.arange(n) / RATE
    goals = 0.7 * (2 * rng.random(int(seconds / 2) + 2) - 1)
    s = np.clip(1.4 * (t % 2.0) / 2.0, 0, 1)
    k = (t // 2).astype(int)
    u = goals[k] + (goals[k + 1] - goals[k]) * (10 * s**3 - 15 * s**4 + 6 * s**5)
    kp, kd, h = INERTIA * 25.0**2, 2 * 0.9 * 25.0 * INERTIA, 1.0 / RATE / FINE
    q, v = float(u[0]), 0.0
    out = np.empty((2, n))
    for i in range(n):
        out[0, i] = q
        out[1, i] = kp * (u[i] - q) - kd * v + GRAVITY * math.sin(q)
        for j in range(FINE):
            target = u[i] + (u[min(i + 1, n - 1)] - u[i]) * j / FINE
            free = v + h * (kp * (target - q) - kd * v - VISCOUS * v) / INERTIA
            brake = h * COULOMB / INERTIA
            v = 0.0 if abs(free) <= brake else free - math.copysign(brake, free)
            q += h * v
    q, effort = out
    q = q + 1e-4 * rng.standard_normal(n)
    effort = effort + 0.02 * rng.standard_normal(n)
    return Log("arm", t, u, q, None, effort, "Nm", joint="1")


def test_commissioning_finds_friction_and_gravity_although_the_joint_rests_often():
    twin = ServoAxis([clean(arm())])
    found = {**twin.joint.nominal, **twin.joint.beside}
    assert found["inertia"] == pytest.approx(INERTIA, rel=0.15)
    assert found["coulomb"] == pytest.approx(COULOMB, rel=0.1)
    assert found["gravity"] == pytest.approx(GRAVITY, rel=0.1)
    assert set(twin.guesses[0]) == {"coulomb", "gravity"}


@pytest.mark.long
def test_friction_and_gravity_are_named_together():
    found = diagnose_joint([arm()], budget=8000).diagnosis
    named = {e.name: e.parameters for e in found.effects}
    assert "gravity" in named and set(named) & {"coulomb", "stribeck", "asymmetric_friction"}
    assert named["gravity"]["gravity"].value == pytest.approx(GRAVITY, rel=0.1)


def test_cogging_that_is_quicker_than_the_smoothing_is_found_by_regression():
    t = np.arange(0.0, 40.0, 0.005)
    q = 1.5 * np.sin(1.5 * t) + 0.5 * np.sin(0.4 * t)
    v, a = np.gradient(q, t), np.gradient(np.gradient(q, t), t)
    plain = 0.05 * a + 0.1 * v + 0.02 * np.random.default_rng(1).standard_normal(t.size)
    ripple = 0.6 * np.sin(50.0 * q + 0.7)
    assert np.max(np.abs(v)) * 50.0 > 2 * np.pi * 15.0
    with_it, without = ([clean(Log("log", t, q, q, v, y, "Nm"))] for y in (plain + ripple, plain))
    found = rippling(with_it, waves(with_it, finest(with_it)))
    assert found["cogging"] == pytest.approx(0.6, rel=0.1)
    assert found["cogging_waves"] == pytest.approx(50.0, abs=0.2)
    assert rippling(without, waves(without, finest(without))) == {}
