"""Controllers that compute their torque: inertia fed forward, gravity held by themselves."""

from __future__ import annotations

import numpy as np
import pytest

from pianobot_ros.axis.log import Log
from pianobot_ros.axis.signals.cleaning import clean
from pianobot_ros.axis.twin.servo_axis import ServoAxis

INERTIA, VISCOUS, DRY, GRAVITY = 0.26, 0.35, 1.2, 4.0
KP, KD = 90.0, 4.0
STEP = 5e-4  # s


def driven(inertia_share: float, gravity_share: float) -> Log:
    """20 s of three sines at 500 Hz; dry friction by a steep tanh, semi-implicit Euler."""
    t = np.arange(0.0, 20.0, STEP)
    waves = ((0.4, 0.4, 0.3), (0.2, 0.9, 1.9), (0.05, 2.1, 4.0))
    u = np.sum([a * np.sin(2 * np.pi * f * t + p) for a, f, p in waves], axis=0)
    du = np.gradient(u, STEP)
    ddu = np.gradient(du, STEP)
    q, v = float(u[0]), float(du[0])
    out = np.empty((3, t.size))
    for k in range(t.size):
        torque = KP * (u[k] - q) + KD * (du[k] - v) + inertia_share * INERTIA * ddu[k]
        torque += gravity_share * GRAVITY * np.sin(q)
        out[:, k] = q, v, torque
        rest = torque - VISCOUS * v - DRY * np.tanh(v / 0.005) - GRAVITY * np.sin(q)
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
