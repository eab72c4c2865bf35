"""One cycle of the emulated arm: joints, tool and loads go together while it moves."""

from __future__ import annotations

import numpy as np
import pytest

from pianobot_ros.emulator.wrist.__main__ import build
from pianobot_ros.emulator.wrist.control.safety import Safety
from pianobot_ros.emulator.wrist.motion.kinematics import from_pose, to_pose, to_rotvec
from pianobot_ros.emulator.wrist.motion.mover import Motion

DT = 0.008


@pytest.fixture
def motion() -> Motion:
    return build("cb3", None, Safety(0.0, 0.0), lambda _: None).motion


def moving(motion: Motion) -> None:
    """On the way to a place aside, turned a little, with the keys pushing."""
    aside = to_pose(motion.tool @ from_pose(np.array([0.02, -0.01, 0.03, 0.0, 0.05, 0.02])))
    motion.servo_to(motion.flange_of(aside))
    for _ in range(4):
        assert motion.step(DT, np.array([0.5, -1.0, 6.0])) is None


def test_the_joints_are_where_the_flange_is(motion: Motion) -> None:
    moving(motion)
    flange = motion.joints.kinematics.forward(motion.joints.q)
    assert flange == pytest.approx(motion.flange, abs=1e-6)


def test_the_joints_turn_as_fast_as_the_wrist_moves(motion: Motion) -> None:
    moving(motion)
    before, twist = motion.joints.jacobian.copy(), motion.twist.copy()
    motion.step(DT, np.zeros(3))
    assert before @ motion.joints.qd == pytest.approx(motion.twist, abs=1e-6)
    assert np.abs(motion.twist - twist).max() > 1e-3, "it still moves"


def test_what_is_told_of_the_tool_is_its_own_derivative_and_target(motion: Motion) -> None:
    moving(motion)
    pose, twist, target, lag = motion.told()
    assert pose == pytest.approx(to_pose(motion.tool), abs=1e-9)
    reach = motion.tool[:3, 3] - motion.pose[:3]
    assert twist[:3] == pytest.approx(motion.twist[:3] + np.cross(motion.twist[3:], reach))
    aside = from_pose(target)
    behind = aside[:3, 3] - motion.tool[:3, 3]
    assert np.linalg.norm(behind) > 1e-3, "it is on its way"
    step = motion.joints.jacobian @ lag
    assert step[:3] == pytest.approx(behind, abs=1e-3)
    assert step[3:] == pytest.approx(
        to_rotvec(aside[:3, :3] @ motion.tool[:3, :3].T), abs=0.2 * np.linalg.norm(step[3:])
    )


def test_a_push_shows_in_the_torques_by_the_jacobian(motion: Motion) -> None:
    moving(motion)
    joints, push = motion.joints, np.array([1.0, 2.0, -3.0])
    joints.bear(motion.pose[:3], np.zeros(3))
    free = joints.torque.copy()
    joints.bear(motion.pose[:3], push)
    assert joints.torque - free == pytest.approx(-joints.jacobian[:3].T @ push, abs=1e-9)
    arm = joints.kinematics.geometry
    drive = joints.torque + np.array(arm.friction) * joints.qd + np.array(arm.inertia) * joints.qdd
    assert joints.current == pytest.approx(drive / np.array(arm.torque_per_ampere))
