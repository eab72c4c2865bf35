"""A load pair: what a heavy joint carries more than in its reference is named, with its size."""

from __future__ import annotations

import numpy as np
import pytest

from pianobot_ros.axis.commissioning.combinations import usual
from pianobot_ros.axis.diagnosis.joint import diagnose_joint
from pianobot_ros.axis.diagnosis.unsure_reference import within_reference
from pianobot_ros.axis.log import Log
from pianobot_ros.axis.signals.cleaning import clean
from pianobot_ros.axis.twin.servo_axis import ServoAxis
from pianobot_ros.gap import Diagnosis
from pianobot_ros.gap.diagnosis import Candidate

INERTIA, GRAVITY, HANGS, FRICTION, VISCOUS = 2.0, 30.0, -1.2, 8.0, 10.0
MASS, ARM, G = 5.0, 0.7, 9.81


def joint(seed, mass, seconds=24.0, rate=100.0):
    """A log of a position loop with integral action; friction also grows with the load, which the
    twin is not told.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(0, seconds, 1 / rate)
    u = 0.7 * np.sin(0.9 * t) + 0.35 * np.sin(2.3 * t + 1) + 0.1 * np.sin(5.1 * t) + 0.3
    du, h = np.gradient(u, t), 1 / rate / 10
    inertia, gravity = INERTIA + mass * ARM**2, GRAVITY + mass * G * ARM
    kp, kd = INERTIA * 25.0**2, 2 * 0.9 * 25.0 * INERTIA
    q, v, gathered = u[0], 0.0, 0.0
    position, effort = np.empty(t.size), np.empty(t.size)
    for i in range(t.size):
        position[i] = q
        for k in range(10):
            error = u[i] + (u[min(i + 1, t.size - 1)] - u[i]) * k / 10 - q
            gathered += error * h
            torque = kp * (error + 2 * gathered) + kd * (du[i] - v)
            if k == 0:
                effort[i] = torque
            load = gravity * np.sin(q - HANGS)
            free = v + h * (torque - load - VISCOUS * v) / inertia
            brake = h * (FRICTION + 0.04 * abs(load)) / inertia
            v = np.sign(free) * max(abs(free) - brake, 0.0)
            q += h * v
    position += 2e-5 * rng.standard_normal(t.size)
    effort += 0.3 * rng.standard_normal(t.size)
    return Log("a", t, u, position, np.gradient(position, t), effort, "Nm", (), "j")


def test_friction_and_gravity_are_found_by_regression():
    found = usual(ServoAxis([clean(joint(1, 0.0))]).joint)
    assert found["coulomb"]["coulomb"] == pytest.approx(FRICTION + 0.04 * GRAVITY, rel=0.2)
    assert found["gravity"]["gravity"] == pytest.approx(GRAVITY, rel=0.1)
    assert found["gravity"]["gravity_angle"] == pytest.approx(HANGS, abs=0.1)


@pytest.mark.long
@pytest.mark.slow
def test_an_added_mass_is_named_with_its_size():
    found = diagnose_joint([joint(2, MASS)], reference=[joint(1, 0.0)], budget=16_000)
    (effect,) = found.diagnosis.effects
    assert effect.name == "payload"
    values = {n: p.value for n, p in effect.parameters.items()}
    assert values["payload_gravity"] == pytest.approx(MASS * G * ARM, rel=0.15)
    assert values["payload_inertia"] == pytest.approx(MASS * ARM**2, rel=0.15)


def said(verdict, none, unknown):
    candidates = (Candidate("none", "", none), Candidate("unknown", "", unknown))
    return Diagnosis(verdict, "", (), candidates, ("none",), (), (), (), None, (), None, (), 0.0)


def test_none_beside_a_reference_that_is_unexplained_is_unknown():
    found = within_reference(said("none", 0.98, 0.02), said("unknown", 0.1, 0.9))
    assert found.verdict == "unknown" and found.credible_set == ("unknown",)
    assert {c.name: c.probability for c in found.candidates} == {"unknown": 0.98, "none": 0.02}
    assert within_reference(said("none", 0.98, 0.02), said("effect", 0.0, 0.1)).verdict == "none"
