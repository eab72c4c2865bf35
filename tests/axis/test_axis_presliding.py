"""Friction whose contact bends before it slips (Canudas de Wit et al. 1995): over a distance that
hangs on the contact, however far the joint travels. It is friction, and no play and no spring.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numba import njit

from pianobot_ros.axis.diagnosis.joint import diagnose_logs, prepared
from pianobot_ros.axis.laws.friction.presliding import advance, slowed
from pianobot_ros.axis.log import Log

RATE, FINE = 100.0, 1e-4
"""Hz of the log; s, a step of the plant."""
LEVEL, RISE, SLOW = 0.8, 0.2, 0.05
"""Friction that slips, what it is more at rest (Nm), and the speed (rad/s) by which that goes."""
BENDS = 2000.0
"""Nm/rad; 0.4 mrad at the level of slip."""


@njit(cache=True)
def _run(command: np.ndarray, inertia: float, viscous: float) -> np.ndarray:
    """Angle and torque (2, n) of a joint behind a position and a speed loop."""
    h = 1e-4
    q, v, z, held = command[0], 0.0, 0.0, 0.0
    out = np.empty((2, command.size))
    for i in range(command.size):
        slope = (command[min(i + 1, command.size - 1)] - command[i]) / h
        off = 12.0 * (command[i] - q) + slope - v
        held += 8.0 * 18.0 * off * h
        torque = 18.0 * off + held
        slip = LEVEL + RISE * math.exp(-((v / SLOW) ** 2))
        before = z
        z = (z + h * v) / (1.0 + h * BENDS * abs(v) / slip)
        damped = 14.0 * (z - before) / h
        v += h * (torque - BENDS * z - damped - viscous * v) / inertia
        q += h * v
        out[0, i], out[1, i] = q, torque
    return out


def _moves(seconds: float) -> np.ndarray:
    """Command (n,) of moves of random lengths with rests between them."""
    rng = np.random.default_rng(60)
    t = np.arange(round(seconds / FINE)) * FINE
    command, at, start = np.zeros(t.size), 0.0, 0.0
    while start < seconds:
        goal = rng.uniform(-0.9, 0.9)
        lasts = max(0.35, 1.9 * abs(goal - at) / rng.uniform(0.4, 1.2))
        s = np.clip((t - start) / lasts, 0.0, 1.0)
        command += (goal - at) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        at, start = goal, start + lasts + rng.uniform(0.2, 1.0)
    return command


def _log(seconds: float) -> Log:
    """Angle, speed and torque of a joint with bristles, logged without noise."""
    every = round(1.0 / (RATE * FINE))
    angle, torque = _run(_moves(seconds), 0.3, 0.5)[:, ::every]
    t = np.arange(angle.size) / RATE
    return Log("bench", t, None, angle, np.gradient(angle, 1.0 / RATE), torque, "Nm")


@pytest.mark.parametrize("distance", [0.0, 1e-12, 1e-4, 0.3])
def test_a_step_ends_at_the_speed_that_its_own_friction_leaves(distance):
    """Implicit: the friction is that of the contact as it is bent at the end of the step."""
    rng = np.random.default_rng(2)
    for free, brake, bent in zip(
        rng.normal(0, 0.1, 500), rng.exponential(0.1, 500), rng.uniform(-1, 1, 500), strict=True
    ):
        speed = slowed(free, brake, bent, 1e-3, distance)
        assert abs(speed) <= abs(free) + brake
        if distance > 0.0 and abs(speed) > 1e-9:
            left = free - brake * advance(bent, 1e-3 * speed, distance)
            assert speed == pytest.approx(left, rel=1e-6, abs=1e-9)
        if distance < 1e-9:
            rigid = math.copysign(max(abs(free) - brake, 0.0), free)
            assert speed == pytest.approx(rigid, abs=1e-6)


def test_a_joint_under_less_than_its_friction_rests_where_the_contact_bears_it():
    h, distance, inertia, level, load = 1e-3, 5e-4, 0.3, 1.0, 0.6
    q = v = bent = 0.0
    for k in range(20_000):  # so slowly that it does not swing
        pull = load * min(1.0, k / 15_000)
        v = slowed(v + h * pull / inertia, h * level / inertia, bent, h, distance)
        bent = advance(bent, h * v, distance)
        q += h * v
    assert abs(v) < 1e-6
    assert bent == pytest.approx(load / level, rel=1e-3)
    assert q == pytest.approx(-distance * math.log(1.0 - load / level), rel=0.05)  # exponential


def test_a_contact_that_bends_says_what_a_rigid_one_leaves():
    """Of effort and free motion, each start and stop in a rest of less than a millirad."""
    twin, blocks, _ = prepared([_log(12.0)], None, None)
    own = {p.name: p.nominal for p in twin.parameters} | {"inertia": 0.3, "viscous": 0.5}
    own |= {"stribeck_level": LEVEL, "stribeck_rise": RISE, "stribeck_speed": SLOW}
    left = {}
    for distance in (1e-6, LEVEL / BENDS):
        made = twin.simulate(blocks, {**own, "presliding": distance}, ("stribeck",))
        for o in twin.observables:
            off = [
                np.asarray(p[o.name]) - b.outputs[o.signal].y
                for b, p in zip(blocks, made, strict=True)
                if o.name in p
            ]
            left[o.name, distance] = float(np.nanmean(np.concatenate(off) ** 2))
    for name in ("effort", "free motion"):
        assert left[name, LEVEL / BENDS] < 0.5 * left[name, 1e-6], name


def test_the_distance_is_not_fitted_to_what_smoothing_leaves_of_noise():
    """It had gone to its bound in a pendulum's log, and left gravity open."""
    clear = _log(12.0)
    noise = np.random.default_rng(1).normal(0.0, 5e-3, clear.t.size)
    noisy = replace(clear, position=clear.position + noise, velocity=None)
    for log, offered in ((clear, True), (noisy, False)):
        twin, _, _ = prepared([log], None, None)
        assert ("presliding" in {p.name for p in twin.parameters}) is offered


@pytest.mark.long
def test_bristles_are_friction_and_no_play():
    """Called *backlash* of a millirad beside friction, at 0.91."""
    found = diagnose_logs([_log(30.0)])
    values = {n: e.value for own in found.effects for n, e in own.parameters.items()}
    assert {e.name for e in found.effects} == {"stribeck"}
    assert values["stribeck_level"] == pytest.approx(LEVEL, rel=0.2)
    assert found.parameters["presliding"].value == pytest.approx(LEVEL / BENDS, rel=0.5)
