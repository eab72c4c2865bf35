"""A load on a spring behind the motor, with the encoder on either side of it."""

from __future__ import annotations

import numpy as np
import pytest

from pianobot_ros.axis.diagnosis.joint import diagnose_joint
from pianobot_ros.axis.laws.readings import Readings
from pianobot_ros.axis.log import Log
from pianobot_ros.axis.signals.cleaning import clean
from pianobot_ros.axis.twin.servo_axis import ServoAxis

RATE, STEP = 500.0, 2e-4
MOTOR, LOAD, SPRING, LOSS = 0.25, 0.14, 170.0, 0.22
"""kg m² of motor and load, Nm/rad and Nm s/rad between them."""
STIFFNESS, DAMPING, DRAG = 900.0, 35.0, 1.0
"""The motor's position loop, Nm/rad and Nm s/rad, and its viscous friction, Nm s/rad."""
PERIOD, SHARE = 2 * np.pi * np.sqrt(LOAD / SPRING), LOAD / (LOAD + MOTOR)
STOPS = (0.0, 0.6, 0.2, 0.9, -0.3)
EVERY, SPEED, RISE = 1.4, 2.2, 25.0
"""s between two moves, rad/s and rad/s² of their trapezoids."""


def moves(t):
    """Commands (n,) from stop to stop."""
    out, at = np.zeros(t.size), STOPS[0]
    for k in range(int(t[-1] / EVERY)):
        goal = STOPS[(k + 1) % len(STOPS)]
        way, since = abs(goal - at), np.clip(t - 0.3 - k * EVERY, 0.0, None)
        ramp = min(SPEED / RISE, np.sqrt(way / RISE))
        flat = way / (RISE * ramp) - ramp
        up, down = np.clip(since, 0, ramp), np.clip(since - ramp - flat, 0, ramp)
        steady = np.clip(since - ramp, 0, flat)
        gone = 0.5 * RISE * up**2 + RISE * ramp * (steady + down) - 0.5 * RISE * down**2
        out += np.sign(goal - at) * gone
        at = goal
    return out


def joint(behind, seconds=25.0, both=False):
    """Log of the joint; the encoder is `behind` the spring, or there is one on `both` sides."""
    fine = np.arange(0.0, seconds, STEP)
    command = moves(fine)
    slope = np.gradient(command, STEP)
    rows = np.empty((fine.size, 3))
    q = v = load = speed = 0.0
    for i in range(fine.size):
        torque = STIFFNESS * (command[i] - q) + DAMPING * (slope[i] - v)
        twist = SPRING * (q - load) + LOSS * (v - speed)
        rows[i] = q, load, torque
        v += STEP * (torque - DRAG * v - twist) / MOTOR
        q += STEP * v
        speed += STEP * twist / LOAD
        load += STEP * speed
    keep = slice(None, None, round(1.0 / (RATE * STEP)))
    t, command, (q, load, torque) = fine[keep], command[keep], rows[keep].T
    rng = np.random.default_rng(5)
    position = np.where(behind, load, q) + 7e-5 * rng.standard_normal(t.size)
    effort = torque + 0.08 * rng.standard_normal(t.size)
    link = load + 7e-5 * rng.standard_normal(t.size) if both else None
    return Log("ringing", t, command, position, None, effort, "Nm", joint="ringing", link=link)


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("behind", [False, True])
def test_a_ringing_load_is_no_integrator(behind):
    found = diagnose_joint([joint(behind)]).diagnosis
    (effect,) = found.effects
    assert effect.name == "elasticity"
    values = {n: p.value for n, p in effect.parameters.items()}
    assert values["elastic_output"] == pytest.approx(float(behind), abs=0.1)
    if behind:  # the same motion could be that of a soft loop, so the values are less sure
        return
    assert values["elastic_period"] == pytest.approx(PERIOD, rel=0.05)
    assert values["elastic_share"] == pytest.approx(SHARE, abs=0.05)


@pytest.mark.slow
def test_encoders_on_both_sides_show_the_spring():
    """Its share of the inertia too, which the motor alone hardly tells."""
    (effect,) = diagnose_joint([joint(behind=False, seconds=10.0, both=True)]).diagnosis.effects
    assert effect.name == "elasticity"
    values = {n: p.value for n, p in effect.parameters.items()}
    assert values.keys() == {"elastic_period", "elastic_share", "elastic_damping"}
    assert values["elastic_period"] == pytest.approx(PERIOD, rel=0.05)
    assert values["elastic_share"] == pytest.approx(SHARE, abs=0.03)


def loose(gap, flank=9000.0):
    """Log of a joint with a `gap` (rad) before a load that nothing but its inertia holds."""
    fine = np.arange(0.0, 8.0, STEP)
    command = 0.5 * np.sin(0.9 * fine) + 0.2 * np.sin(3.8 * fine)
    slope = np.gradient(command, STEP)
    rows = np.empty((fine.size, 3))
    q = load = 0.5 * gap
    v = speed = 0.0
    for i in range(fine.size):
        torque = STIFFNESS * (command[i] - q) + DAMPING * (slope[i] - v)
        beyond = max(abs(q - load) - 0.5 * gap, 0.0) * np.sign(q - load)
        push = flank * beyond + (4.0 * (v - speed) if beyond else 0.0)
        rows[i] = q, load, torque
        free = v + STEP * (torque - DRAG * v - push) / MOTOR
        v = np.sign(free) * max(abs(free) - STEP * 1.5 / MOTOR, 0.0)
        q += STEP * v
        speed += STEP * push / LOAD
        load += STEP * speed
    keep = slice(None, None, round(1.0 / (RATE * STEP)))
    q, load, torque = rows[keep].T
    t, u = fine[keep], command[keep]
    return Log("loose", t, u, q, None, torque, "Nm", joint="loose", link=load)


def test_a_gap_is_tried_with_a_load_that_its_inertia_alone_holds():
    """A load that its own friction held would change flanks elsewhere."""
    c = clean(loose(0.016))
    twin = ServoAxis([c])
    left = []
    for guess in (g for g in twin.guesses if "backlash" in g):
        p = twin.joint.vector({n: x for own in guess.values() for n, x in own.items()})
        field = twin.joint.others.field(p, {}, c.q.size)
        off = (Readings.of(c).moved(p).twist(field) - c.twist)[c.valid]
        left.append(np.std(off) / np.std(c.twist[c.valid]))
    assert min(left) < 0.5
