"""The node ``ur5_wrist`` as a process of its own, against the emulated controller, on a ROS domain
of its own.
"""

from __future__ import annotations

import os
import random
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import psutil
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from pianobot_msgs.msg import WristCommand, WristState
from rcl_interfaces.srv import DescribeParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from pianobot_ros.emulator.wrist.process import EmulatedUr, loopback_address
from pianobot_ros.nodes import common
from pianobot_ros.testing import wait_for

pytestmark = pytest.mark.graph


def start_node(domain: int, *parameters: str) -> subprocess.Popen[str]:
    arguments = [word for parameter in parameters for word in ("-p", parameter)]
    return subprocess.Popen(
        [sys.executable, "-m", "pianobot_ros.nodes.ur5_wrist", "--ros-args", *arguments],
        env={**os.environ, "ROS_DOMAIN_ID": str(domain)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


class Graph:
    """A client of the node: everything it publishes, and a way to command it."""

    def __init__(self, domain: int) -> None:
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = Node("tester", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.clients: dict[str, Any] = {}
        self.states: list[WristState] = []
        self.joints: list[JointState] = []
        self.diagnostics: list[DiagnosticStatus] = []
        self.node.create_subscription(
            WristState, "/real/wrist/state", self.states.append, common.SENSOR_QOS
        )
        self.node.create_subscription(
            JointState, "/real/joint_states", self.joints.append, common.SENSOR_QOS
        )
        self.node.create_subscription(
            DiagnosticArray, "/diagnostics", lambda array: self.diagnostics.extend(array.status), 10
        )
        self.commands = self.node.create_publisher(
            WristCommand, "/command/wrist", common.command_publisher_qos()
        )

    def until(self, condition: Callable[[], Any], what: str, limit: float = 30.0) -> None:
        wait_for(condition, what, limit, turn=lambda: self.executor.spin_once(timeout_sec=0.02))

    def call(self, kind: Any, name: str, request: Any, limit: float = 30.0) -> Any:
        if name not in self.clients:
            self.clients[name] = self.node.create_client(kind, name)
        client = self.clients[name]
        self.until(client.service_is_ready, f"service {name}", limit)
        future = client.call_async(request)
        self.until(future.done, f"answer of {name}", limit)
        return future.result()

    def position(self) -> np.ndarray:
        p = self.states[-1].pose.position
        return np.array([p.x, p.y, p.z])

    def command(self, position: np.ndarray, due_ns: int | None = None) -> None:
        message = WristCommand()
        message.header.stamp = common.time_msg(time.time_ns() if due_ns is None else due_ns)
        point = message.pose.position
        point.x, point.y, point.z = (float(value) for value in position)
        message.pose.orientation.w = 1.0
        self.commands.publish(message)

    def stream(
        self, velocity: list[float], seconds: float, bunch: int = 1
    ) -> tuple[float, np.ndarray]:
        """Setpoints 0.1 s before their time, ``bunch`` of them together; returns when the motion
        began and from where.
        """
        start, begun, period = self.position(), time.monotonic(), 0.008
        wall = time.time_ns() + 100_000_000
        for cycle in range(1, round(seconds / period) + 1):
            while cycle % bunch == 0 and (left := begun + cycle * period - time.monotonic()) > 0.0:
                self.executor.spin_once(timeout_sec=left)
            self.command(
                start + np.array(velocity) * cycle * period, wall + round(cycle * period * 1e9)
            )
        return 1e-9 * wall, start

    def healthy(self) -> bool:
        return bool(self.diagnostics) and self.diagnostics[-1].level == DiagnosticStatus.OK

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[EmulatedUr]:
    with EmulatedUr(tmp_path_factory.mktemp("wrist")) as robot:
        yield robot


@pytest.fixture(scope="module")
def domain() -> int:
    return random.randint(1, 100)


@pytest.fixture(scope="module")
def shared_graph(robot: EmulatedUr, domain: int) -> Iterator[Graph]:
    process = start_node(domain, f"host:='{robot.host}'")
    graph = Graph(domain)
    yield graph
    graph.close()
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=60)
    assert process.returncode == 0, output
    assert "Traceback" not in output
    assert "command rejected: wrist setpoint is not finite" in output


@pytest.fixture
def graph(shared_graph: Graph) -> Graph:
    shared_graph.diagnostics.clear()
    shared_graph.until(shared_graph.healthy, "the node healthy")
    shared_graph.until(
        lambda: shared_graph.commands.get_subscription_count() == 1,
        "the command subscriber matched",
    )
    return shared_graph


def test_states_come_with_every_package_of_the_controller(graph: Graph) -> None:
    graph.states.clear()
    graph.joints.clear()
    graph.until(
        lambda: len(graph.states) > 50 and len(graph.joints) > 50, "states and joint states"
    )
    state = graph.states[-1]
    assert state.header.frame_id == "base"
    assert state.safety_state == WristState.SAFETY_NORMAL
    assert state.program_running
    assert abs(state.pose.orientation.w) == pytest.approx(1.0, abs=1e-3)
    cycles = np.diff([s.controller_time for s in graph.states]) / 0.008
    assert np.median(cycles) == pytest.approx(1.0)
    stamps = [common.seconds(s.header.stamp) for s in graph.states]
    assert np.all(np.diff(stamps) > 0.0)
    assert abs(stamps[-1] - time.time()) < 5.0
    assert len(graph.joints[-1].name) == len(graph.joints[-1].position) == 6


def test_a_stream_moves_the_wrist_and_its_end_stops_it(graph: Graph, robot: EmulatedUr) -> None:
    before = graph.position()
    graph.stream([0.0, 0.0, 0.05], 0.4)
    graph.until(lambda: robot.status()["mode"] == "hold", "the arm stopped")
    graph.states.clear()
    graph.until(lambda: len(graph.states) > 20, "fresh states")
    moved = graph.position() - before
    assert moved[:2] == pytest.approx([0.0, 0.0], abs=1e-3)
    assert moved[2] == pytest.approx(0.02, abs=1e-3)
    graph.stream([0.0, 0.0, -0.05], 0.4)
    graph.until(lambda: robot.status()["mode"] == "hold", "the arm stopped again")


def test_how_setpoints_arrive_does_not_shape_the_motion(graph: Graph, robot: EmulatedUr) -> None:
    graph.states.clear()
    graph.until(lambda: graph.states, "a fresh state")
    begun, start = graph.stream([0.0, 0.0, 0.1], 0.3, bunch=4)
    graph.until(lambda: robot.status()["mode"] == "hold", "the arm stopped")
    times = np.array([common.seconds(s.header.stamp) for s in graph.states]) - begun
    heights = np.array([s.pose.position.z for s in graph.states]) - start[2]
    steady = (times > 0.15) & (times < 0.3)
    assert steady.sum() > 10
    # A second-order servo is behind a ramp by 2 / omega, and 4 ms more for holding each setpoint.
    behind = times[steady] - heights[steady] / 0.1
    assert np.ptp(behind) < 1.5e-3 and behind.mean() == pytest.approx(2 / 60.0 + 0.004, abs=0.003)
    graph.stream([0.0, 0.0, -0.1], 0.3)
    graph.until(lambda: robot.status()["mode"] == "hold", "the arm stopped again")


def test_a_publisher_that_promises_no_deadline_is_heard_too(graph: Graph) -> None:
    plain = graph.node.create_publisher(
        WristCommand, "/command/wrist", QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
    )
    graph.until(lambda: plain.get_subscription_count() == 1, "the plain publisher matched")
    target = graph.states[-1].target_pose.position.z
    message = WristCommand()
    position = graph.position() + np.array([0.0, 0.0, 0.001])
    message.pose.position.x, message.pose.position.y, message.pose.position.z = map(float, position)
    message.pose.orientation.w = 1.0
    plain.publish(message)
    graph.until(
        lambda: abs(graph.states[-1].target_pose.position.z - target) > 2e-4, "the setpoint echoed"
    )
    graph.node.destroy_publisher(plain)


def test_bad_commands_are_counted_and_nothing_else_is_lost(graph: Graph) -> None:
    def rejected() -> int:
        values = {value.key: value.value for value in graph.diagnostics[-1].values}
        return int(values["rejected"])

    before, here = rejected(), graph.position()
    graph.command(np.array([np.nan, 0.3, 0.3]))
    graph.until(lambda: rejected() == before + 1, "the NaN counted")
    graph.command(np.array([0.0, 0.3, 2.0]))
    graph.until(lambda: rejected() == before + 2, "the pose outside counted")
    graph.states.clear()
    graph.until(lambda: len(graph.states) > 20, "states still flow")
    assert graph.position() == pytest.approx(here, abs=2e-3)
    assert graph.healthy()


def test_protective_stop_is_reported_and_recover_works(graph: Graph, robot: EmulatedUr) -> None:
    robot.fault("pstop")
    graph.until(
        lambda: graph.states[-1].safety_state == WristState.SAFETY_PROTECTIVE_STOP,
        "protective stop in the state",
    )
    graph.until(
        lambda: "PROTECTIVE_STOP" in graph.diagnostics[-1].message,
        "protective stop in the diagnostics",
    )
    assert graph.diagnostics[-1].level == DiagnosticStatus.ERROR
    graph.states.clear()
    answer = graph.call(Trigger, "/ur5_wrist/recover", Trigger.Request())
    assert answer.success, answer.message
    assert graph.states, "no state was published while the arm recovered"
    graph.until(lambda: graph.states[-1].program_running, "program running again")


def test_emergency_stop_is_reported_and_recover_works_after_release(
    graph: Graph, robot: EmulatedUr
) -> None:
    robot.fault("estop")
    graph.until(
        lambda: graph.states[-1].safety_state == WristState.SAFETY_EMERGENCY_STOP,
        "emergency stop in the state",
    )
    answer = graph.call(Trigger, "/ur5_wrist/recover", Trigger.Request())
    assert not answer.success
    assert "release the button" in answer.message
    robot.fault("unlock")
    answer = graph.call(Trigger, "/ur5_wrist/recover", Trigger.Request())
    assert answer.success, answer.message


def test_stop_service_holds_the_arm_until_recover(graph: Graph) -> None:
    assert graph.call(Trigger, "/ur5_wrist/stop", Trigger.Request()).success
    here = graph.position()
    graph.stream([0.05, 0.0, 0.0], 0.2)
    assert graph.position() == pytest.approx(here, abs=2e-3)
    assert graph.call(Trigger, "/ur5_wrist/recover", Trigger.Request()).success
    graph.stream([0.05, 0.0, 0.0], 0.2)
    graph.until(lambda: graph.position()[0] > here[0] + 5e-3, "the arm moves again")


def test_it_reconnects_by_itself(graph: Graph, robot: EmulatedUr) -> None:
    robot.fault("drop")
    graph.until(
        lambda: graph.diagnostics[-1].level == DiagnosticStatus.ERROR, "loss in the diagnostics"
    )
    graph.until(graph.healthy, "the link back")


def test_it_is_active_and_its_parameters_are_described(graph: Graph) -> None:
    assert (
        graph.call(GetState, "/ur5_wrist/get_state", GetState.Request()).current_state.label
        == "active"
    )
    request = DescribeParameters.Request(names=["speed_limit", "stale_time", "host", "gain"])
    descriptors = graph.call(
        DescribeParameters, "/ur5_wrist/describe_parameters", request
    ).descriptors
    assert all(descriptor.description for descriptor in descriptors)
    assert descriptors[0].floating_point_range[0].to_value == 3.0


def test_a_lifecycle_manager_can_take_it_down_and_up_again(graph: Graph) -> None:
    def change(transition: int) -> bool:
        request = ChangeState.Request(transition=Transition(id=transition))
        return bool(graph.call(ChangeState, "/ur5_wrist/change_state", request).success)

    assert change(Transition.TRANSITION_DEACTIVATE)
    graph.until(lambda: graph.commands.get_subscription_count() == 0, "the command subscriber gone")
    assert change(Transition.TRANSITION_CLEANUP)
    assert change(Transition.TRANSITION_CONFIGURE)
    graph.states.clear()
    assert change(Transition.TRANSITION_ACTIVATE)
    graph.until(lambda: graph.states, "states again")
    graph.diagnostics.clear()
    graph.until(graph.healthy, "healthy again")


@pytest.mark.parametrize(
    ("parameter", "why"),
    [
        ("speed_limit:=50.0", "speed_limit.*in \\[0.01, 3\\]"),
        ("sped_limit:=0.5", "did you mean 'speed_limit'"),
        ("gain:=loud", "'gain' must be a number"),
        ("config:=nowhere.yaml", "nowhere.yaml"),
    ],
)
def test_bad_parameters_end_it_with_one_line(domain: int, parameter: str, why: str) -> None:
    process = start_node(domain, parameter)
    output, _ = process.communicate(timeout=60)
    assert process.returncode == 2
    assert output.startswith("error: ")
    assert len(output.splitlines()) == 1
    assert re.search(why, output), output


def test_without_a_robot_it_says_so_once_and_waits(tmp_path: Any) -> None:
    domain, host = random.randint(101, 200), loopback_address()
    process = start_node(domain, f"host:='{host}'", "retry_period:=0.2")
    graph = Graph(domain)
    try:
        graph.until(
            lambda: graph.diagnostics and "refused" in graph.diagnostics[-1].message,
            "the problem reported",
        )
        with EmulatedUr(tmp_path, host=host):
            graph.until(graph.healthy, "the robot found")
            process.send_signal(signal.SIGTERM)
            output, _ = process.communicate(timeout=60)
    finally:
        process.kill()
        graph.close()
    assert process.returncode == 0
    assert output.count("cannot configure") == 1, output


def test_the_successor_of_a_killed_node_moves_the_arm_without_being_asked(tmp_path: Any) -> None:
    domain = random.randint(101, 200)
    with EmulatedUr(tmp_path) as robot:
        process = start_node(domain, f"host:='{robot.host}'")
        graph = Graph(domain)
        try:
            graph.until(graph.healthy, "the first node healthy")
            driver = psutil.Process(process.pid).children(recursive=True)
            assert driver, "the driver is a process of its own"
            # Or it may notice its node's end, and end its program in order, before the kernel ends
            # it.
            for own in driver:
                own.suspend()
            process.kill()
            process.communicate(timeout=60)
            process = start_node(domain, f"host:='{robot.host}'")
            graph.until(
                lambda: not any(d.is_running() for d in driver), "the driver ended with its node"
            )
            graph.until(
                lambda: robot.status()["events"].get("watchdog") == 1,
                "the controller's watchdog stopped the arm",
            )
            begun = time.time()
            graph.until(
                lambda: (
                    common.seconds(graph.states[-1].header.stamp) > begun
                    and graph.states[-1].program_running
                ),
                "the program runs again",
            )
            here = graph.position()
            # The killed node's subscriber may count as alive for a while, so one cannot wait for
            # the new one: stream again.
            graph.until(
                lambda: (
                    graph.stream([0.0, 0.0, 0.02], 0.1) and graph.position()[2] > here[2] + 2e-4
                ),
                "the arm moves again",
            )
        finally:
            process.kill()
            process.communicate(timeout=60)
            graph.close()
