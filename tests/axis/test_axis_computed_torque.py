"""Controllers that compute their torque: inertia fed forward, gravity held by themselves."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from pianobot_ros.axis.commissioning.commissioned import _compensated
from pianobot_ros.axis.log import Log
from pianobot_ros.axis.signals.cleaning import clean
from pianobot_ros.axis.twin.servo_axis import ServoAxis

INERTIA, VISCOUS, DRY, GRAVITY = 0.26, 0.35, 1.2, 4.0
KP, KD = 90.0, 4.0
STEP = 5e-4  # s


def driven(inertia_share: float, load_share: float, constant: float = 0.0) -> Log:
    """20 s of three sines at 500 Hz; dry friction by a steep tanh, semi-implicit Euler. The load is
    gravity, or `constant` (Nm) in its place.
    """
    t = np.arange(0.0, 20.0, STEP)
    waves = ((0.4, 0.4, 0.3), (0.2, 0.9, 1.9), (0.05, 2.1, 4.0))
    u = np.sum([a * np.sin(2 * np.pi * f * t + p) for a, f, p in waves], axis=0)
    du = np.gradient(u, STEP)
    ddu = np.gradient(du, STEP)
    q, v = float(u[0]), float(du[0])
    out = np.empty((3, t.size))
    for k in range(t.size):
        torque = KP * (u[k] - q) + KD * (du[k] - v) + inertia_share * INERTIA * ddu[k]
        load = constant or GRAVITY * np.sin(q)
        torque += load_share * load
        out[:, k] = q, v, torque
        rest = torque - VISCOUS * v - DRY * np.tanh(v / 0.005) - load
        v += STEP * rest / INERTIA
        q += STEP * v
    rng = np.random.default_rng(1)
    seen = out[:, ::4] + np.array([[1e-5], [2e-3], [0.03]]) * rng.standard_normal((3, t.size // 4))
    return Log("computed", t[::4], u[::4], *seen, "Nm")


@pytest.mark.parametrize(("inertia", "gravity"), [(0.9, 0.95), (0.9, 0.0), (0.0, 0.95), (0.0, 0.0)])
def test_what_a_controller_feeds_forward_is_part_of_its_loop(inertia, gravity):
    known = ServoAxis([clean(driven(inertia, gravity))]).joint.nominal
    assert known["bandwidth"] == pytest.approx(np.sqrt(KP / INERTIA), rel=0.2)
    assert known["inertia_feedforward"] == pytest.approx(inertia, abs=0.15)
    assert known["load_feedforward"] == pytest.approx(gravity, abs=0.15)


@pytest.mark.parametrize("share", [1.0, 0.0])
def test_a_constant_load_is_borne_by_the_loop_or_held_like_gravity(share):
    """A lift whose drive holds its weight stands where it is sent: a twin whose loop has to bear it
    had a sensor that is off by as much.
    """
    known = ServoAxis([clean(driven(0.0, share, constant=6.0))]).joint.nominal
    assert known["load_feedforward"] == pytest.approx(share, abs=0.05)


def test_a_sine_and_a_constant_that_cancel_are_no_load():
    """Over a short travel a regression tells them apart by chance."""
    log = SimpleNamespace(q=np.linspace(0.0, 0.1, 50))
    assert _compensated([log], np.array([0.0, 5.0, -5.0]), np.zeros(3), 1.0) == 0.0
    assert _compensated([log], np.array([0.0, 0.0, -5.0]), np.zeros(3), 1.0) == 1.0
