"""Kinematics of the emulated arm: forward, inverse, derivative and load agree with each other."""

from __future__ import annotations

import numpy as np
import pytest

from pianobot_ros.emulator.wrist.motion.kinematics import (
    MODELS,
    Kinematics,
    from_pose,
    to_pose,
    to_rotvec,
    transform,
)

GRAVITY = 9.81


@pytest.fixture(params=sorted(MODELS))
def kinematics(request: pytest.FixtureRequest) -> Kinematics:
    return Kinematics(MODELS[request.param])


def regular_configurations(kinematics: Kinematics, count: int = 40) -> list[np.ndarray]:
    """Joint angles away from singularities, where an inverse is well conditioned."""
    random = np.random.default_rng(7)
    found = []
    while len(found) < count:
        q = random.uniform(-2.8, 2.8, 6)
        frames = kinematics.frames(q)
        if np.linalg.cond(kinematics.jacobian(frames, frames[6, :3, 3])) < 60.0:
            found.append(q)
    return found


def test_ur5_stretched_out_reaches_as_far_as_its_data_sheet_says() -> None:
    flange = Kinematics(MODELS["UR5"]).forward(np.zeros(6))
    # Universal Robots' own zero pose: arm stretched along -x.
    assert flange[:3, 3] == pytest.approx([-0.81725, -0.19145, -0.005491], abs=1e-6)


def test_every_inverse_solution_puts_the_flange_where_it_belongs(kinematics: Kinematics) -> None:
    for q in regular_configurations(kinematics):
        flange = kinematics.forward(q)
        solutions = kinematics.solutions(flange)
        assert solutions
        assert kinematics.in_reach(flange)
        for solution in solutions:
            assert kinematics.forward(solution) == pytest.approx(flange, abs=1e-6)


def test_inverse_finds_the_configuration_near_the_given_one(kinematics: Kinematics) -> None:
    random = np.random.default_rng(3)
    for q in regular_configurations(kinematics):
        found = kinematics.inverse(kinematics.forward(q), q + random.normal(0.0, 0.02, 6))
        assert found is not None
        assert found == pytest.approx(q, abs=1e-5)


def test_out_of_reach_has_no_inverse(kinematics: Kinematics) -> None:
    flange = np.eye(4)
    flange[:3, 3] = [2.0, 0.0, 0.3]
    assert kinematics.inverse(flange, np.zeros(6)) is None
    assert not kinematics.in_reach(flange)


def test_tracking_converges_from_nearby(kinematics: Kinematics) -> None:
    random = np.random.default_rng(5)
    for q in regular_configurations(kinematics):
        flange = kinematics.forward(q)
        tracked = kinematics.track(flange, q + random.normal(0.0, 0.005, 6))
        assert kinematics.forward(tracked) == pytest.approx(flange, abs=1e-5)


def test_jacobian_is_the_derivative_of_the_position(kinematics: Kinematics) -> None:
    step = 1e-6
    for q in regular_configurations(kinematics, 10):
        frames = kinematics.frames(q)
        jacobian = kinematics.jacobian(frames, frames[6, :3, 3])
        for joint in range(6):
            delta = step * np.eye(6)[joint]
            ahead, behind = kinematics.forward(q + delta), kinematics.forward(q - delta)
            assert jacobian[:3, joint] == pytest.approx(
                (ahead - behind)[:3, 3] / (2 * step), abs=1e-6
            )
            assert jacobian[3:, joint] == pytest.approx(
                to_rotvec(ahead[:3, :3] @ behind[:3, :3].T) / (2 * step), abs=1e-6
            )


def test_gravity_torque_is_the_gradient_of_the_potential_energy(kinematics: Kinematics) -> None:
    payload, centre, step = 1.3, np.array([0.01, -0.02, 0.06]), 1e-5

    def energy(q: np.ndarray) -> float:
        frames = kinematics.frames(q)
        links = sum(
            mass * (frame @ np.array([*point, 1.0]))[2]
            for mass, point, frame in zip(
                kinematics.geometry.mass, kinematics.geometry.centre, frames[1:], strict=True
            )
        )
        return GRAVITY * (float(links) + payload * float((frames[6] @ np.array([*centre, 1.0]))[2]))

    for q in regular_configurations(kinematics, 10):
        gradient = [(energy(q + step * e) - energy(q - step * e)) / (2 * step) for e in np.eye(6)]
        assert kinematics.gravity_torque(kinematics.frames(q), payload, centre) == pytest.approx(
            gradient, abs=1e-4
        )


@pytest.mark.parametrize(
    "rotvec", [[0, 0, 0], [1e-9, 0, 0], [0.3, -0.2, 0.9], [np.pi, 0, 0], [0, -2.2, 2.2]]
)
def test_rotation_vectors_survive_the_way_through_a_matrix(rotvec: list[float]) -> None:
    rotation = transform(np.array(rotvec))
    assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-9)
    assert transform(to_rotvec(rotation)) == pytest.approx(rotation, abs=1e-7)
    pose = np.array([0.1, 0.2, 0.3, *rotvec])
    assert from_pose(to_pose(from_pose(pose))) == pytest.approx(from_pose(pose), abs=1e-7)
