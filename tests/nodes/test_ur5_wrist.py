"""The node ``ur5_wrist`` as a process of its own, against the emulated controller, on a ROS domain
of its own.

Controller, driver and test are processes that the machine may hold up at any time. So a motion is
asked for until it is there, a recovery until it succeeds, and how the arm moves is read from the
stretches in which nobody was held up.
"""

from __future__ import annotations

import contextlib
import re
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from pianobot_msgs.msg import WristCommand, WristState
from rcl_interfaces.srv import DescribeParameters
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from pianobot_ros.cell.host.closing import Closing
from pianobot_ros.cell.host.halted import living
from pianobot_ros.emulator.wrist.controller_process import EmulatedUr, loopback_address
from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.base.domain import claim_domain
from pianobot_ros.testing import TIMEOUT, Process, Processes, Ros
from pianobot_ros.testing.running.ros_context import on_this_machine

pytestmark = [pytest.mark.graph, pytest.mark.slow]

Path_ = Callable[[float], np.ndarray]
"""Position (3,) m at a time of a stream, s."""
PERIOD = 0.008  # s between two setpoints
AHEAD = 0.15  # s by which a setpoint is sent before its time; nodes take up to 0.2
LIMIT = 300.0
"""s for a step of node, driver and controller together: a driver that lost its link is a process
that starts anew, which takes long where others start too.
"""


class WristNode(Closing):
    """The node in a domain of its own, and a client of it: everything it publishes, and a way to
    command it.
    """

    def __init__(self, folder: Path, host: str, **parameters: Any) -> None:
        self._held = contextlib.ExitStack()
        self._domain = self._held.enter_context(claim_domain()).number
        environment = {"ROS_DOMAIN_ID": str(self._domain)}
        self._processes = self._held.enter_context(Processes(folder, environment))
        self._parameters = {"host": host, **parameters}
        self.process = self.start("ur5_wrist")
        self._join()

    def _join(self) -> None:
        """Enter the domain as somebody who has never heard of any node."""
        self.ros = self._held.enter_context(Ros(self._domain, self._processes.trouble))
        self.states: list[WristState] = self.ros.record(WristState, "/real/wrist/state")
        self.joints: list[JointState] = self.ros.record(JointState, "/real/joint_states")
        self.diagnostics: list[DiagnosticStatus] = []
        self.ros.tester.create_subscription(
            DiagnosticArray, "/diagnostics", lambda array: self.diagnostics.extend(array.status), 10
        )
        self.commands = self.ros.publisher(
            WristCommand, "/command/wrist", common.command_publisher_qos()
        )

    def until(self, condition: Any, what: str | Callable[[], str]) -> Any:
        """Wait while messages come in."""
        return self.ros.wait_for(condition, what, LIMIT)

    def call(self, kind: Any, name: str, request: Any = None) -> Any:
        """The answer of a service."""
        return self.ros.call(kind, name, request, LIMIT)

    def start(self, log: str) -> Process:
        """Start the node, or its successor, with its output in a log of that name."""
        self.process = self._processes.node("ur5_wrist", log=log, **self._parameters)
        return self.process

    def start_successor(self, log: str) -> None:
        """Start the successor of a node that has ended, and know of that one alone: what the other
        said last may still wait to be heard, and a service of one that was killed counts as there
        for a while, and answers nobody.
        """
        self.ros.close()
        self.start(log)
        self._join()

    def position(self) -> np.ndarray:
        """Where the arm is, as of now: told later than this was asked."""
        now = time.time()
        self.until(lambda: self.since(now), "a fresh state")
        p = self.states[-1].pose.position
        return np.array([p.x, p.y, p.z])

    def since(self, moment: float) -> bool:
        """Whether there is a state of after the ``moment``, s since the epoch."""
        return bool(self.states) and common.seconds(self.states[-1].header.stamp) > moment

    def command(self, position: np.ndarray, due: float | None = None) -> None:
        message = WristCommand()
        message.header.stamp = common.time_msg(round(1e9 * (time.time() if due is None else due)))
        point = message.pose.position
        point.x, point.y, point.z = (float(value) for value in position)
        message.pose.orientation.w = 1.0
        self.commands.publish(message)

    def follow(
        self,
        path: Path_,
        until: Callable[[], Any],
        what: str | Callable[[], str],
        *,
        bunch: int = 1,
    ) -> None:
        """Stream ``path`` until something holds, ``bunch`` setpoints at a time. What a test that
        was held up has not sent in time it leaves out.
        """
        begun, cycle = time.time() + AHEAD, 0

        def send() -> None:
            nonlocal cycle
            now = time.time()
            cycle = max(cycle, int((now - begun) / PERIOD) // bunch * bunch)
            while begun + (cycle + bunch) * PERIOD < now + AHEAD:
                for _ in range(bunch):
                    cycle += 1
                    self.command(path(cycle * PERIOD), begun + cycle * PERIOD)

        self.begun = begun
        self.until(lambda: send() or until(), what)

    def healthy(self) -> bool:
        return bool(self.diagnostics) and self.diagnostics[-1].level == DiagnosticStatus.OK

    def value(self, key: str) -> str:
        """What the newest report says."""
        return next((v.value for v in self.diagnostics[-1].values if v.key == key), "")

    def recover(self) -> str:
        """Have the arm recovered; returns what was said. One attempt ends with the link, if the
        controller is silent for a moment.
        """
        said: list[str] = []

        def recovered() -> bool:
            answer = self.call(Trigger, "/ur5_wrist/recover")
            said.append(answer.message)
            return bool(answer.success)

        self.until(recovered, lambda: f"recovered: {said}")
        return said[-1]

    def close(self) -> None:
        self._held.close()


@pytest.fixture(scope="module", autouse=True)
def only_here() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        on_this_machine(patch)
        yield


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[EmulatedUr]:
    with EmulatedUr(tmp_path_factory.mktemp("wrist")) as robot:
        yield robot


@pytest.fixture(scope="module")
def shared_graph(
    robot: EmulatedUr, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[WristNode]:
    with WristNode(tmp_path_factory.mktemp("node"), robot.host) as graph:
        yield graph
        assert graph.process.end(signal.SIGINT) == 0, graph.process.output()
        output = graph.process.output()
        assert "Traceback" not in output
        assert "command rejected: wrist setpoint is not finite" in output


@pytest.fixture
def graph(shared_graph: WristNode) -> WristNode:
    shared_graph.diagnostics.clear()
    shared_graph.until(shared_graph.healthy, "the node healthy")
    shared_graph.ros.matched(shared_graph.commands)
    return shared_graph


def stopped(graph: WristNode, robot: EmulatedUr) -> None:
    graph.until(lambda: robot.status()["mode"] == "hold", "the arm stopped")


def test_states_come_with_every_package_of_the_controller(graph: WristNode) -> None:
    begun = time.time()
    graph.states.clear()
    graph.joints.clear()
    graph.until(
        lambda: len(graph.states) > 50 and len(graph.joints) > 50 and graph.since(begun),
        "states and joint states",
    )
    state = graph.states[-1]
    assert state.header.frame_id == "base"
    assert state.safety_state == WristState.SAFETY_NORMAL
    assert state.program_running
    assert abs(state.pose.orientation.w) == pytest.approx(1.0, abs=1e-3)
    cycles = np.diff([s.controller_time for s in graph.states]) / PERIOD
    assert np.median(cycles) == pytest.approx(1.0)
    stamps = [common.seconds(s.header.stamp) for s in graph.states]
    assert np.all(np.diff(stamps) > 0.0)
    assert stamps[-1] < time.time(), "measured before it was told"
    assert len(graph.joints[-1].name) == len(graph.joints[-1].position) == 6


def test_a_stream_moves_the_wrist_and_its_end_stops_it(graph: WristNode, robot: EmulatedUr) -> None:
    before, rise = graph.position(), np.array([0.0, 0.0, 0.02])
    graph.follow(
        lambda t: before + rise * min(t / 0.4, 1.0),
        lambda: graph.states[-1].pose.position.z > before[2] + rise[2] - 1e-3,
        "the wrist at the end of the path",
    )
    stopped(graph, robot)
    assert graph.position() == pytest.approx(before + rise, abs=1e-3)
    here = graph.position()
    count = len(graph.states)
    graph.until(lambda: len(graph.states) > count + 20, "further states")
    assert graph.position() == pytest.approx(here, abs=2e-4), "at rest"
    graph.follow(
        lambda t: before + rise * max(1.0 - t / 0.4, 0.0),
        lambda: graph.states[-1].pose.position.z < before[2] + 1e-3,
        "the wrist back",
    )
    stopped(graph, robot)


SPEED, FLANK = 0.1, 0.4  # m/s and s: up and down, each for so long
SETTLED = 0.02  # of the speed: an arm that nothing disturbs moves as evenly
LONG = 15  # states in a row
STRETCHES = 5  # of which most tell the same, wherever the machine was held up
LATENCY = 2 / 60.0 + 0.5 * PERIOD
"""s that a second-order servo is behind a ramp (2 / omega), and what holding each setpoint adds."""


def steady_lags(states: list[WristState], begun: float, low: float) -> list[np.ndarray]:
    """Of each stretch in which the wrist moved evenly up or down: by how much it was behind the
    setpoints, (n,) s.
    """
    stamp, clock, height, speed = np.array(
        [
            (
                common.seconds(s.header.stamp) - begun,
                s.controller_time,
                s.pose.position.z - low,
                s.twist.linear.z,
            )
            for s in states
        ]
    ).T
    even = np.abs(np.abs(speed) - SPEED) < SETTLED * SPEED
    joined = (np.diff(clock) < 1.5 * PERIOD) & (np.diff(np.sign(speed)) == 0) & even[1:] & even[:-1]
    lags = []
    for run in np.split(np.arange(stamp.size), np.flatnonzero(~joined) + 1):
        if run.size < LONG:
            continue
        flank = int((stamp[run].mean() - LATENCY) // FLANK)
        if (flank % 2 == 0) != bool(speed[run[0]] > 0.0):
            continue  # the path was not followed here: the arm was held up, and comes after
        way = height[run] if flank % 2 == 0 else SPEED * FLANK - height[run]
        lags.append(stamp[run] - flank * FLANK - way / SPEED)
    return lags


def test_how_setpoints_arrive_does_not_shape_the_motion(
    graph: WristNode, robot: EmulatedUr
) -> None:
    start = graph.position()
    graph.states.clear()
    lags: list[np.ndarray] = []
    looked = 0

    def seen() -> bool:
        nonlocal looked, lags
        if len(graph.states) > looked + 100:
            looked = len(graph.states)
            lags = steady_lags(graph.states, graph.begun, start[2])
        return len(lags) >= STRETCHES

    def path(t: float) -> np.ndarray:
        way = t % (2 * FLANK)
        return start + np.array([0.0, 0.0, SPEED * min(way, 2 * FLANK - way)])

    graph.follow(path, seen, lambda: f"even motion, but for {len(lags)} stretches", bunch=4)
    assert np.median([np.ptp(lag) for lag in lags]) < 1.5e-3
    assert np.median([lag.mean() for lag in lags]) == pytest.approx(LATENCY, abs=0.003)
    graph.follow(
        lambda _: start,
        lambda: abs(graph.states[-1].pose.position.z - start[2]) < 1e-3,
        "the wrist back",
    )
    stopped(graph, robot)


def test_a_publisher_that_promises_no_deadline_is_heard_too(graph: WristNode) -> None:
    qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
    plain = graph.ros.publisher(WristCommand, "/command/wrist", qos)
    graph.ros.matched(plain)
    position = graph.position() + np.array([0.0, 0.0, 0.001])
    target = graph.states[-1].target_pose.position.z
    message = WristCommand()
    message.pose.position.x, message.pose.position.y, message.pose.position.z = map(float, position)
    message.pose.orientation.w = 1.0
    graph.until(
        lambda: (
            plain.publish(message) or abs(graph.states[-1].target_pose.position.z - target) > 2e-4
        ),
        "the setpoint echoed",
    )
    graph.ros.tester.destroy_publisher(plain)


def test_bad_commands_are_counted_and_nothing_else_is_lost(
    graph: WristNode, robot: EmulatedUr
) -> None:
    stopped(graph, robot)
    before, here, sent = int(graph.value("rejected")), graph.position(), 0
    for bad, reason in (([np.nan, 0.3, 0.3], "not finite"), ([0.0, 0.3, 2.0], "the workspace")):
        # A node that the machine lets wait for 0.2 s refuses whatever comes as too old.
        refused = False
        while not refused:
            graph.command(np.array(bad))
            sent += 1
            graph.until(
                lambda all_of=before + sent: int(graph.value("rejected")) >= all_of,
                lambda reason=reason: f"a refusal: {reason}",
            )
            refused = reason in graph.value("last_refusal")
    assert int(graph.value("rejected")) == before + sent, "each is counted once"
    graph.states.clear()
    graph.until(lambda: len(graph.states) > 20, "states still flow")
    assert graph.position() == pytest.approx(here, abs=2e-3)
    graph.until(graph.healthy, "the node healthy")


def test_protective_stop_is_reported_and_recover_works(graph: WristNode, robot: EmulatedUr) -> None:
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
    begun = time.time()
    graph.recover()
    ended = time.time()
    graph.until(lambda: graph.since(begun), "a state")
    assert any(begun < common.seconds(s.header.stamp) < ended for s in graph.states), (
        "no state was published while the arm recovered"
    )
    graph.until(lambda: graph.states[-1].program_running, "program running again")


def test_emergency_stop_is_reported_and_recover_works_after_release(
    graph: WristNode, robot: EmulatedUr
) -> None:
    robot.fault("estop")
    graph.until(
        lambda: graph.states[-1].safety_state == WristState.SAFETY_EMERGENCY_STOP,
        "emergency stop in the state",
    )

    def refused() -> bool:
        answer = graph.call(Trigger, "/ur5_wrist/recover")
        assert not answer.success, answer.message
        return "release the button" in answer.message

    graph.until(refused, "why it does not recover")
    robot.fault("unlock")
    graph.recover()


def test_stop_service_holds_the_arm_until_recover(graph: WristNode) -> None:
    assert graph.call(Trigger, "/ur5_wrist/stop").success
    here = graph.position()

    def aside(t: float) -> np.ndarray:
        return here + np.array([min(0.05 * t, 0.01), 0.0, 0.0])

    def moved() -> bool:
        return bool(graph.states[-1].pose.position.x > here[0] + 5e-3)

    graph.follow(aside, lambda: "on request" in graph.value("last_refusal"), "refused setpoints")
    assert graph.position() == pytest.approx(here, abs=2e-3)
    graph.recover()
    graph.follow(aside, moved, "the arm moves again")


def test_it_reconnects_by_itself(graph: WristNode, robot: EmulatedUr) -> None:
    robot.fault("drop")
    graph.until(
        lambda: any(s.level == DiagnosticStatus.ERROR for s in graph.diagnostics),
        "loss in the diagnostics",
    )
    graph.until(graph.healthy, "the link back")


def test_it_is_active_and_its_parameters_are_described(graph: WristNode) -> None:
    assert graph.call(GetState, "/ur5_wrist/get_state").current_state.label == "active"
    request = DescribeParameters.Request(names=["speed_limit", "stale_time", "host", "gain"])
    descriptors = graph.call(
        DescribeParameters, "/ur5_wrist/describe_parameters", request
    ).descriptors
    assert all(descriptor.description for descriptor in descriptors)
    assert descriptors[0].floating_point_range[0].to_value == 3.0


def test_a_lifecycle_manager_can_take_it_down_and_up_again(graph: WristNode) -> None:
    def change(transition: int) -> bool:
        request = ChangeState.Request(transition=Transition(id=transition))
        return bool(graph.call(ChangeState, "/ur5_wrist/change_state", request).success)

    assert graph.call(Trigger, "/ur5_wrist/stop").success
    assert change(Transition.TRANSITION_DEACTIVATE)
    graph.until(lambda: graph.commands.get_subscription_count() == 0, "the command subscriber gone")
    assert change(Transition.TRANSITION_CLEANUP)
    graph.until(lambda: change(Transition.TRANSITION_CONFIGURE), "configured")
    begun = time.time()
    assert change(Transition.TRANSITION_ACTIVATE)
    graph.until(lambda: graph.since(begun), "states again")
    graph.diagnostics.clear()
    graph.until(lambda: graph.diagnostics, "word of the arm")
    assert not graph.healthy()  # a stop outlasts its driver
    graph.recover()
    graph.until(graph.healthy, "healthy again")


def test_a_setpoint_that_waited_is_not_obeyed(graph: WristNode) -> None:
    old = WristCommand()
    old.header.stamp = common.time_msg(time.time_ns() - 10**9)
    old.pose.position.x, old.pose.position.y, old.pose.position.z = graph.position().tolist()
    graph.commands.publish(old)
    graph.until(lambda: "old" in graph.value("last_refusal"), "its refusal")


@pytest.mark.parametrize(
    ("parameter", "why"),
    [
        ("speed_limit:=50.0", "speed_limit.*in \\[0.01, 3\\]"),
        ("sped_limit:=0.5", "did you mean 'speed_limit'"),
        ("use_sim_time:=true", "'use_sim_time' must stay false"),
        pytest.param("gain:=loud", "'gain' must be a number", marks=pytest.mark.long),
        pytest.param("config:=nowhere.yaml", "nowhere.yaml", marks=pytest.mark.long),
    ],
)
def test_bad_parameters_end_it_with_one_line(
    ros_domain: int, processes: Processes, parameter: str, why: str
) -> None:
    process = processes.python(
        "pianobot_ros.nodes.devices.ur5_wrist", "--ros-args", "-p", parameter
    )
    assert process.wait(TIMEOUT) == 2
    output = process.output()
    assert output.startswith("error: ")
    assert len(output.splitlines()) == 1
    assert re.search(why, output), output


def test_without_a_robot_it_says_so_once_and_waits(tmp_path: Path) -> None:
    host = loopback_address()
    with WristNode(tmp_path, host, retry_period=1.0) as graph:
        graph.until(
            lambda: graph.diagnostics and "refused" in graph.diagnostics[-1].message,
            "the problem reported",
        )
        graph.diagnostics.clear()
        graph.until(lambda: len(graph.diagnostics) > 2, "further attempts")
        assert graph.process.output().count("cannot configure") == 1, graph.process.output()
        with EmulatedUr(tmp_path, host=host):
            graph.until(graph.healthy, "the robot found")
            assert graph.process.end(signal.SIGTERM) == 0


def test_the_successor_of_a_killed_node_moves_the_arm_without_being_asked(tmp_path: Path) -> None:
    with EmulatedUr(tmp_path) as robot, WristNode(tmp_path, robot.host) as graph:

        def bitten() -> int:
            return int(robot.status()["events"].get("watchdog", 0))

        graph.until(graph.healthy, "the first node healthy")
        driver = graph.process.family()
        assert driver, "the driver is a process of its own"
        # Or it may notice its node's end, and end its program in order, before the kernel ends it.
        for own in driver:
            own.suspend()
        before = bitten()
        graph.process.end(signal.SIGKILL)
        graph.start("successor")
        graph.until(lambda: gone(driver), "the driver ended with its node")
        graph.until(lambda: bitten() > before, "the controller's watchdog stopped the arm")
        begun = time.time()
        graph.until(
            lambda: graph.since(begun) and graph.states[-1].program_running,
            "the program runs again",
        )
        here = graph.position()
        # The killed node's subscriber may count as alive for a while, so one cannot wait for the
        # new one: the stream goes on until it is heard.
        graph.follow(
            lambda t: here + np.array([0.0, 0.0, min(0.02 * t, 0.01)]),
            lambda: graph.states[-1].pose.position.z > here[2] + 2e-4,
            "the arm moves again",
        )


def outlasts(graph: WristNode, hold: Callable[[], None], reason: str) -> None:
    """What holds the arm outlasts a node that is killed, until it is recovered, and not one that
    ends in order.
    """

    def held() -> bool:
        return bool(graph.diagnostics and reason in graph.diagnostics[-1].message)

    for end, still in ((signal.SIGKILL, True), (signal.SIGTERM, False)):
        graph.until(graph.healthy, "healthy")
        hold()
        graph.until(held, f"'{reason}' in the diagnostics")
        graph.process.end(end)
        graph.start_successor(f"after {end.name}")
        graph.until(held if still else graph.healthy, "the successor's word")
        if still:
            graph.recover()


def test_a_stop_outlasts_a_killed_node_but_not_one_that_ends_in_order(tmp_path: Path) -> None:
    with EmulatedUr(tmp_path) as robot, WristNode(tmp_path, robot.host) as graph:

        def stop() -> None:
            assert graph.call(Trigger, "/ur5_wrist/stop").success

        outlasts(graph, stop, "on request")


def test_a_program_that_a_person_ended_stays_so_until_it_is_asked_for(tmp_path: Path) -> None:
    with EmulatedUr(tmp_path) as robot, WristNode(tmp_path, robot.host) as graph:
        outlasts(graph, lambda: robot.fault("killprog"), "does not run")


def gone(processes: list[psutil.Process]) -> bool:
    return not living(processes)
