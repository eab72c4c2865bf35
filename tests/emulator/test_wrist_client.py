"""The unmodified client library against the emulated controller, at both rates."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import rtde_control
import rtde_receive

from pianobot_ros.emulator.wrist.controller_process import EmulatedUr

pytestmark = pytest.mark.graph


@dataclass
class Robot:
    """Both interfaces of the library, and the controller's own view."""

    emulated: EmulatedUr
    control: Any
    receive: Any
    period: float
    home: list[float]

    def pose(self) -> np.ndarray:
        return np.array(self.receive.getActualTCPPose())

    def shifted(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> np.ndarray:
        return self.pose() + np.array([x, y, z, 0.0, 0.0, 0.0])

    def logged(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[str]]:
        """What the controller has written of its motion up to now, see EmulatedUr.motion."""
        now = time.monotonic()
        self.settle(lambda: self.emulated.motion()[0][-1:] > now)
        return self.emulated.motion()

    def settle(self, condition: Callable[[], bool], limit: float = 60.0) -> None:
        deadline = time.monotonic() + limit
        while not condition():
            assert time.monotonic() < deadline, "the condition never became true"
            time.sleep(self.period)


@pytest.fixture(scope="module", params=["cb3", pytest.param("e-series", marks=pytest.mark.long)])
def robot(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Robot]:
    rate = {"cb3": 125.0, "e-series": 500.0}[request.param]
    with EmulatedUr(tmp_path_factory.mktemp("wrist"), request.param) as emulated:
        control = rtde_control.RTDEControlInterface(emulated.host, rate)
        receive = rtde_receive.RTDEReceiveInterface(emulated.host, rate)
        yield Robot(emulated, control, receive, 1.0 / rate, receive.getActualTCPPose())
        control.stopScript()
        control.disconnect()
        receive.disconnect()


@pytest.fixture(autouse=True)
def at_home(robot: Robot) -> None:
    assert robot.control.moveL(robot.home, 0.5, 3.0)


def test_state_is_consistent(robot: Robot) -> None:
    robot.settle(lambda: np.max(np.abs(robot.receive.getActualTCPSpeed())) < 1e-2)
    forward = robot.control.getForwardKinematics()
    assert forward[:3] == pytest.approx(robot.pose()[:3], abs=1e-3)
    assert robot.receive.getRobotMode() == 7
    assert robot.receive.getSafetyMode() == 1
    currents = np.array(robot.receive.getActualCurrent())
    assert np.max(np.abs(currents[1:3])) > 0.1  # shoulder and elbow carry the arm
    assert np.max(np.abs(currents)) < 10.0


def test_time_goes_on_in_cycles(robot: Robot) -> None:
    first = robot.receive.getTimestamp()
    robot.settle(lambda: robot.receive.getTimestamp() > first + 0.1)
    cycles = (robot.receive.getTimestamp() - first) / robot.period
    assert cycles == pytest.approx(round(cycles), abs=1e-6)


def test_move_l_and_move_j_arrive(robot: Robot) -> None:
    target = robot.shifted(0.03, 0.04, -0.05)
    assert robot.control.moveL(list(target), 0.5, 3.0)
    robot.settle(lambda: np.allclose(robot.pose()[:3], target[:3], atol=5e-4))
    joints = np.array(robot.receive.getActualQ()) + 0.05
    assert robot.control.moveJ(list(joints), 1.0, 4.0)
    robot.settle(lambda: np.allclose(robot.receive.getActualQ(), joints, atol=1e-3))
    assert robot.control.moveJ_IK(list(target), 1.0, 4.0)
    robot.settle(lambda: np.allclose(robot.pose()[:3], target[:3], atol=5e-4))


def test_servo_l_is_followed_and_servo_stop_stops(robot: Robot) -> None:
    start, begun = robot.pose(), time.monotonic()
    for cycle in range(round(0.5 / robot.period)):
        target = start - np.array([0.0, 0.0, 0.04 * cycle * robot.period, 0.0, 0.0, 0.0])
        robot.control.servoL(list(target), 0.5, 0.5, robot.period, 0.03, 300)
        time.sleep(max(0.0, begun + (cycle + 1) * robot.period - time.monotonic()))
    robot.settle(lambda: abs(robot.pose()[2] - target[2]) < 1e-3)
    # As the controller has it: this process, kept waiting, sees less of it.
    times, _, velocity, modes = robot.logged()
    servo = np.array([mode == "servo" for mode in modes]) & (times > begun)
    assert np.min(velocity[servo, 2]) < -0.02, "it went with the stream"
    assert robot.control.servoStop(10.0)
    robot.settle(lambda: abs(robot.receive.getActualTCPSpeed()[2]) < 2e-3)
    assert robot.pose()[2] == pytest.approx(target[2], abs=5e-3)


def test_servo_j_is_followed(robot: Robot) -> None:
    joints = np.array(robot.receive.getActualQ())
    for cycle in range(round(0.4 / robot.period)):
        robot.control.servoJ(
            list(joints + 0.1 * cycle * robot.period), 0.5, 0.5, robot.period, 0.03, 300
        )
        time.sleep(robot.period)
    robot.settle(lambda: np.allclose(robot.receive.getActualQ(), joints + 0.04, atol=5e-3))
    assert robot.control.servoStop(10.0)
    assert robot.receive.getActualQ() == pytest.approx(list(joints + 0.04), abs=0.02)


def test_speed_l_and_speed_j_keep_their_speed_until_stopped(robot: Robot) -> None:
    robot.control.speedL([0.0, 0.0, -0.05, 0.0, 0.0, 0.0], 2.0, 0.0)
    robot.settle(lambda: abs(robot.receive.getActualTCPSpeed()[2] + 0.05) < 5e-3)
    assert robot.control.speedStop(5.0)
    robot.settle(lambda: abs(robot.receive.getActualTCPSpeed()[2]) < 2e-3)
    robot.control.speedJ([0.1, 0.0, 0.0, 0.0, 0.0, 0.0], 2.0, 0.0)
    robot.settle(lambda: abs(robot.receive.getActualQd()[0] - 0.1) < 1e-2)
    assert robot.control.speedStop(5.0)
    robot.settle(lambda: abs(robot.receive.getActualQd()[0]) < 5e-3)


def test_a_move_can_be_stopped_on_the_way(robot: Robot) -> None:
    start = robot.pose()
    target = robot.shifted(0.1, 0.1)
    assert robot.control.moveL(list(target), 0.01, 1.0, True)  # takes 14 s
    robot.settle(lambda: robot.pose()[0] > start[0] + 1e-3)
    robot.control.stopL(5.0)
    robot.settle(lambda: np.max(np.abs(robot.receive.getActualTCPSpeed()[:3])) < 2e-3)
    assert start[0] + 1e-3 < robot.pose()[0] < target[0] - 0.02


def test_queries(robot: Robot) -> None:
    near = robot.receive.getActualQ()
    solution = robot.control.getInverseKinematics(list(robot.pose()), near, 1e-10, 1e-10)
    assert solution == pytest.approx(near, abs=1e-2)
    assert robot.control.isPoseWithinSafetyLimits(list(robot.pose()))
    assert not robot.control.isPoseWithinSafetyLimits([2.0, 0.0, 0.3, 0.0, 0.0, 0.0])
    assert robot.control.isJointsWithinSafetyLimits([0.0] * 6)
    assert not robot.control.isJointsWithinSafetyLimits([7.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    robot.settle(robot.control.isSteady)


def test_speed_slider_slows_a_planned_move(robot: Robot) -> None:
    robot.emulated.fault("speed 0.25")
    robot.settle(lambda: robot.receive.getTargetSpeedFraction() == pytest.approx(0.25))
    begun, start = time.monotonic(), robot.pose()
    assert robot.control.moveL(list(robot.shifted(z=-0.03)), 0.2, 2.0, True)
    robot.settle(lambda: robot.pose()[2] < start[2] - 0.01)
    times, _, velocity, _ = robot.logged()
    robot.control.stopL(5.0)
    robot.emulated.fault("speed 1")
    assert 0.02 < np.max(np.abs(velocity[times > begun, 2])) < 0.07


def test_protective_stop_stops_and_the_program_can_be_started_again(robot: Robot) -> None:
    robot.control.speedL([0.0, 0.0, -0.05, 0.0, 0.0, 0.0], 2.0, 0.0)
    robot.settle(lambda: robot.receive.getActualTCPSpeed()[2] < -0.04)
    robot.emulated.fault("pstop")
    robot.settle(robot.receive.isProtectiveStopped)
    robot.settle(lambda: abs(robot.receive.getActualTCPSpeed()[2]) < 2e-3)
    assert not robot.control.moveL(list(robot.pose()), 0.1, 1.0)
    robot.settle(lambda: _accepted(robot, "unlock"))
    assert robot.control.reuploadScript()
    robot.settle(robot.control.isProgramRunning)
    assert robot.control.moveL(list(robot.shifted(z=0.01)), 0.1, 1.0)


def test_watchdog_stops_the_program_of_a_silent_client(robot: Robot) -> None:
    assert robot.control.setWatchdog(20.0)
    robot.control.kickWatchdog()
    robot.settle(lambda: robot.emulated.status()["events"].get("watchdog", 0) > 0)
    assert not robot.control.isProgramRunning() or robot.emulated.status()["program"] == "STOPPED"
    assert robot.control.reuploadScript()
    robot.settle(robot.control.isProgramRunning)


def _accepted(robot: Robot, fault: str) -> bool:
    try:
        robot.emulated.fault(fault)
    except Exception:
        return False
    return True
