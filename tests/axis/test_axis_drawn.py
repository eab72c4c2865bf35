"""What neighbouring joints' accelerations draw is found, and only where they do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pianobot_ros.axis.commissioning.around.arm import coupling
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


def swept(dry: float, late: float, falling: float = 0.0) -> tuple[np.ndarray, ...]:
    """Stamps, command, position and effort (n,) of a joint that a chirp sweeps: inertia 0.2,
    viscous friction 4.6, dry friction, of which some falls with speed, and effort that acts late
    (s).
    """
    t, fine = np.arange(4000) * 0.005, 10
    command = 0.5 * np.sin(2 * np.pi * (0.1 * t + 0.05 * t**2))
    q, effort, x, v, dt = np.empty(t.size), np.empty(t.size), 0.0, 0.0, 0.005 / fine
    acting = [0.0] * (1 + round(late / dt))
    for k in range(t.size):
        q[k] = 3.8e-4 * round(x / 3.8e-4)
        effort[k] = 80.0 * (command[k] - q[k]) - 2.5 * v
        for _ in range(fine):
            acting.append(float(effort[k]))
            friction = (dry + falling * np.exp(-((v / 0.3) ** 2))) * np.tanh(v / 0.005)
            v += (acting.pop(0) - friction - 4.6 * v) / 0.2 * dt
            x += v * dt
    return t, command, q, effort


def test_joints_that_one_command_moves_do_not_tell_whose_an_effort_is():
    """The neighbours have nothing to do with the joint, but their motion has its rates, and is not
    quite the same: their accelerations took most of its inertia.
    """
    t, command, q, effort = swept(2.2, 0.013)
    others = {"1": swept(2.2, 0.0)[2], "3": swept(1.6, 0.005, 1.0)[2]}
    names = ("1", "2", "3")
    log = Log("legs", t, command, q, None, effort, "Nm", (), "2", others=others, joints=names)
    cleaned = clean(log)
    (found,), said = with_neighbours([cleaned])
    assert found.drawn is None and not said
    assert not coupling([cleaned], "2", names)


def arm_of(pull: float, angles: dict[str, np.ndarray], q: np.ndarray) -> Log:
    """A first joint whose effort the last of all turns, by a weight of `pull` and by 0.1 of inertia
    shared.
    """
    v, far = derivative(q, 0.01), angles[max(angles)]
    effort = INERTIA * derivative(v, 0.01) + FRICTION * np.tanh(v / 0.02) + 2.0 * np.cos(q)
    effort += pull * (np.sin(far) + 0.1 * derivative(derivative(far, 0.01), 0.01))
    effort += 0.02 * np.random.default_rng(0).standard_normal(T.size)
    joints = ("1", *angles)
    return Log("arm", T, None, q, None, effort, "Nm", (), "1", others=angles, joints=joints)


RATES = {"2": (1.7, 3.1), "3": (0.8, 2.3), "4": (1.3, 3.7)}
WANDERING = {
    n: 0.6 * np.sin(a * T + b) + 0.4 * np.sin(b * T + a) - 1.5 for n, (a, b) in RATES.items()
}


def test_a_joint_far_away_in_the_arm_is_found_and_named():
    log = clean(arm_of(1.5, WANDERING, 0.6 * np.sin(1.1 * T) + 0.4 * np.sin(2.7 * T + 1.0)))
    (found,), said = with_neighbours([log], anywhere=True)
    assert found.drawn is not None and "most of all that of 4" in said
    beside = regress([found])
    assert beside["inertia"] == pytest.approx(INERTIA, rel=0.1)
    assert beside["coulomb"] == pytest.approx(FRICTION, rel=0.1)
    assert beside["gravity"] == pytest.approx(2.0, rel=0.1)
    (known,), _ = with_neighbours([log])  # what holds near these poses says nothing of other logs
    assert known.drawn is None


def test_few_poses_of_a_task_do_not_tell_what_each_joint_draws():
    """Ten times from pose to pose and back, all joints together: any weights of them would do."""
    along = 0.5 - 0.5 * np.cos(2 * np.pi * T / 3.5)
    task = {n: a * along + b * along**2 for n, (a, b) in RATES.items()}
    task["2"] = np.full(T.size, 0.3)  # no neighbour moves
    log = clean(arm_of(0.0, task, 1.2 * along))
    extra = 1.5 * np.sin(3.0 * along)  # what the twin lacks is no other joint's
    (found,), said = with_neighbours([replace(log, effort=log.effort + extra)], anywhere=True)
    assert found.drawn is None and not said


def test_a_gait_does_not_tell_whose_an_effort_is():
    """All joints swing at the harmonics of one stride, each with phases of its own."""
    stride = 2 * np.pi * 0.61 * T + 0.3 * np.sin(0.11 * T)

    def swing(a: float, b: float) -> np.ndarray:
        return 0.5 * np.sin(stride + a) + 0.2 * np.sin(2 * stride + b) + 0.1 * np.sin(0.07 * a * T)

    gait = {n: swing(a, b) for n, (a, b) in RATES.items()}
    log = clean(arm_of(1.5, gait, swing(0.4, 2.0)))
    assert "as a sum" not in with_neighbours([log], anywhere=True)[1]
