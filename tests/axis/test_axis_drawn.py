"""What neighbouring joints' accelerations draw is found, and only where they do."""

from __future__ import annotations

import numpy as np
import pytest

from pianobot_ros.axis.commissioning.around.neighbours import with_neighbours
from pianobot_ros.axis.commissioning.regression import regress
from pianobot_ros.axis.log import Log
from pianobot_ros.axis.signals.cleaning import clean
from pianobot_ros.axis.signals.filtering import derivative

T = np.arange(4000) * 0.01
INERTIA, FRICTION, SHARED = 0.5, 0.8, 0.12


def log_of(shared: float) -> Log:
    """A joint that moves with its neighbour; they share `shared` of inertia when aligned."""
    q = 0.6 * np.sin(1.1 * T) + 0.4 * np.sin(2.7 * T + 1.0)
    theta = 0.8 * np.sin(1.7 * T + 0.5) + 0.5 * np.sin(3.1 * T)
    v, w = derivative(q, 0.01), derivative(theta, 0.01)
    a, b = derivative(v, 0.01), derivative(w, 0.01)
    drawn = shared * (np.cos(theta) * (2 * a + b) - np.sin(theta) * (2 * v * w + w**2))
    effort = INERTIA * a + FRICTION * np.tanh(v / 0.02) + drawn
    effort += 0.02 * np.random.default_rng(0).standard_normal(T.size)
    others, joints = {"2": theta}, ("1", "2")
    return Log("arm", T, None, q, None, effort, "Nm", (), "1", others=others, joints=joints)


def test_inertia_that_two_joints_share_is_fitted():
    (found,), said = with_neighbours([clean(log_of(SHARED))])
    assert found.drawn is not None and "accelerations of 2" in said
    beside = regress([found])
    assert beside["inertia"] == pytest.approx(INERTIA, rel=0.1)
    assert beside["coulomb"] == pytest.approx(FRICTION, rel=0.1)


def test_joints_that_share_none_stay_as_they_are():
    (found,), said = with_neighbours([clean(log_of(0.0))])
    assert found.drawn is None and not said


def test_a_joint_that_moves_at_the_same_rates_does_not_explain_what_the_twin_lacks():
    """Effort that comes late leaves sines of every rate of the motion, and so has the neighbour."""
    rates = np.array([0.9, 2.3, 5.6, 10.7])
    q, theta = (
        np.sum(0.5 / rates * np.sin(np.outer(T, rates) + phases), axis=1)
        for phases in ([0.0, 1.0, 2.0, 3.0], [2.5, 0.3, 4.0, 1.0])
    )
    a = derivative(derivative(q, 0.01), 0.01)
    effort = INERTIA * np.interp(T - 0.05, T, a)
    effort += 0.01 * np.random.default_rng(0).standard_normal(T.size)
    log = Log(
        "arm", T, None, q, None, effort, "Nm", (), "1", others={"2": theta}, joints=("1", "2")
    )
    (found,), said = with_neighbours([clean(log)])
    assert found.drawn is None and not said
