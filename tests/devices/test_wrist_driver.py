"""The driver against the emulated controller: following, stopping, and coming back from every
fault.
"""

from __future__ import annotations

import contextlib
import math
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from pianobot_ros.cell.host.priority import REALTIME_PRIORITY, thread_ids
from pianobot_ros.devices.base import (
    CommandRejectedError,
    Device,
    DeviceUnavailableError,
    HealthLevel,
)
from pianobot_ros.devices.wrist.config import UrConfig
from pianobot_ros.devices.wrist.driver import UrDriver
from pianobot_ros.devices.wrist.messages import HALT, SETPOINT
from pianobot_ros.devices.wrist.wrist_reading import SafetyState, WristSetpoint
from pianobot_ros.emulator.wrist.controller_process import EmulatedUr, loopback_address
from pianobot_ros.testing import wait_for

pytestmark = [pytest.mark.graph, pytest.mark.slow]


def config_for(host: str, **link: float) -> UrConfig:
    config = UrConfig.load()
    return config.model_copy(update={"link": config.link.model_copy(update={"host": host, **link})})


REFUSED = (CommandRejectedError, DeviceUnavailableError)


AHEAD = 0.15
"""s that setpoints are written before their time, so that a test process that is kept waiting does
not shape the motion.
"""


def soon(position: np.ndarray, velocity: Sequence[float] = (0.0,) * 6) -> WristSetpoint:
    """A setpoint that is due :data:`AHEAD` s from now."""
    return WristSetpoint(position, np.zeros(3), np.array(velocity), time.time() + AHEAD)


def moves(driver: UrDriver, way: list[float]) -> None:
    """Wait until the arm has gone ``way`` m, by setpoints ahead of their time: a process beside
    busy ones sends few, and without any the arm stops after 18 ms. A machine that stands still may
    cost the controller's program meanwhile; then it goes on once that runs again.
    """
    reading = driver.latest()
    assert reading is not None
    start, begun, goal = np.array(reading.position), time.monotonic(), np.array(way)

    def arrived() -> bool:
        done = min(1.0, 0.03 * (time.monotonic() - begun) / float(np.linalg.norm(goal)))
        with contextlib.suppress(*REFUSED):
            driver.write(soon(start + done * goal))
        newest = driver.latest()
        return newest is not None and bool(
            np.linalg.norm(np.array(newest.position) - start - goal) < 1e-3
        )

    wait_for(arrived, "the arm to move")


def recover(driver: UrDriver) -> tuple[bool, str]:
    answer: list[tuple[bool, str]] = []
    done = threading.Event()
    driver.recover(lambda ok, text: (answer.append((ok, text)), done.set()))  # type: ignore[func-returns-value]
    assert done.wait(60.0), "recovery gave no answer"
    return answer[0]


def recovers(driver: UrDriver) -> None:
    """Ask until it has worked: whoever loses the link on the way is told so, and asks again."""
    said: list[str] = []

    def recovered() -> bool:
        ok, text = recover(driver)
        said.append(text)
        return ok

    wait_for(recovered, lambda: f"the arm to recover: {said}")


def hold(driver: UrDriver) -> WristSetpoint:
    reading = driver.latest()
    assert reading is not None
    return WristSetpoint(np.array(reading.position), np.zeros(3), np.zeros(6))


def goes_on(pid: int) -> None:
    """Let a stopped process go on, if it has not been replaced: that may have taken so long."""
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, signal.SIGCONT)


def ready(driver: UrDriver) -> bool:
    return driver.health().level is HealthLevel.OK


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[EmulatedUr]:
    with EmulatedUr(tmp_path_factory.mktemp("wrist")) as robot:
        yield robot


@pytest.fixture(scope="module")
def shared_driver(robot: EmulatedUr) -> Iterator[UrDriver]:
    # What a machine that stands still for less than half a second costs neither program nor link.
    driver = UrDriver(config_for(robot.host, watchdog_rate=2.0, state_timeout=0.5))
    driver.connect()
    yield driver
    driver.close()


@pytest.fixture
def driver(shared_driver: UrDriver, robot: EmulatedUr) -> UrDriver:
    if robot.status()["safety"] != "NORMAL":  # what a test that failed has left
        robot.fault("unlock")
        recovers(shared_driver)
    wait_for(lambda: ready(shared_driver), lambda: f"the driver: {shared_driver.health().message}")
    return shared_driver


def test_it_is_a_device_and_reports_the_arm(driver: UrDriver) -> None:
    assert isinstance(driver, Device)
    wait_for(lambda: driver.health().age_s < 0.1, "a fresh state")
    wait_for(lambda: driver.latest().program_running, "the program's state")  # type: ignore[union-attr]
    reading = driver.latest()
    assert reading is not None
    assert reading.safety is SafetyState.NORMAL
    assert reading.rotation == pytest.approx([0.0, 0.0, 0.0], abs=1e-2)


def may_use_realtime() -> bool:
    """Whether the kernel lets processes of this one have real-time priority. Asked by trying:
    CAP_SYS_NICE is neither needed (a limit RLIMIT_RTPRIO will do) nor enough (a control group
    without real-time bandwidth refuses root, too).
    """
    highest = REALTIME_PRIORITY + 2  # the library's receiving thread has it
    ask = f"import os; os.sched_setscheduler(0, os.SCHED_RR, os.sched_param({highest}))"
    asked = subprocess.run([sys.executable, "-c", ask], stderr=subprocess.DEVNULL, check=False)
    return asked.returncode == 0


def test_every_thread_that_servo_commands_wait_for_has_the_workers_class(driver: UrDriver) -> None:
    allowed = may_use_realtime()
    expected = os.SCHED_RR if allowed else os.SCHED_OTHER

    def classes() -> tuple[int, set[int], bool]:
        """The worker's class, those of its other threads, and whether they come before it."""
        pid = driver.process_id
        assert pid is not None
        others = thread_ids(pid) - {pid}
        assert len(others) >= 1, "the library receives on a thread of its own"
        own = os.sched_getparam(pid).sched_priority
        first = all(os.sched_getparam(thread).sched_priority > own for thread in others)
        return os.sched_getscheduler(pid), {os.sched_getscheduler(t) for t in others}, first

    def as_wanted() -> bool:
        with contextlib.suppress(AssertionError, ProcessLookupError):  # another one is on its way
            return classes() == (expected, {expected}, allowed)
        return False

    wait_for(as_wanted, lambda: f"the worker's class {expected}, not {classes()}")


def stream_ahead(driver: UrDriver, velocity: list[float], seconds: float) -> float:
    """A steady motion, each setpoint of which is written :data:`AHEAD` s before its time; returns
    the last one's monotonic time.
    """
    reading = driver.latest()
    assert reading is not None
    start, period = np.array(reading.position), 0.008
    begun, wall = time.monotonic(), time.time()
    last = 0.0
    for cycle in range(1, round(seconds / period) + 1):
        time.sleep(max(0.0, begun + cycle * period - time.monotonic()))
        last = AHEAD + cycle * period
        position = start + np.array(velocity) * cycle * period
        with contextlib.suppress(*REFUSED):  # while the program that a stall has cost is restarted
            driver.write(
                WristSetpoint(
                    position, np.zeros(3), np.array([*velocity, 0.0, 0.0, 0.0]), wall + last
                )
            )
    return begun + last


def test_a_stream_is_followed_and_echoed(driver: UrDriver) -> None:
    goal = hold(driver).position + np.array([0.0, 0.025, 0.0])
    stream_ahead(driver, [0.0, 0.05, 0.0], 0.5)

    def followed() -> bool:
        if driver.latest().servoing:  # type: ignore[union-attr]
            return False
        there = bool(np.allclose(hold(driver).position, goal, atol=4e-3, rtol=0.0))
        with contextlib.suppress(*REFUSED):  # the end of a stream that a stall cut off
            there or driver.write(soon(goal))
        return there

    wait_for(followed, "the end of the stream")
    assert driver.latencies()  # how many is the machine's affair (benchmarks/wrist_link.py)
    moves(driver, [0.0, -0.025, 0.0])


@pytest.mark.parametrize("direction", [1, pytest.param(-1, marks=pytest.mark.long)])
def test_a_stale_stream_stops_the_arm(tmp_path: Path, direction: int) -> None:
    with EmulatedUr(tmp_path) as robot:
        # Neither watchdog nor link ends it before the driver does, however slow this machine is.
        driver = UrDriver(config_for(robot.host, watchdog_rate=0.02, state_timeout=5.0))
        driver.connect()
        try:
            wait_for(lambda: ready(driver), "driver ready")
            stops_when_stale(driver, robot, direction)
        finally:
            driver.close()


def stops_when_stale(driver: UrDriver, robot: EmulatedUr, direction: int) -> None:
    tripped = robot.status()["events"].get("watchdog", 0)
    begun = time.monotonic()
    last = stream_ahead(driver, [0.15 * direction, 0.0, 0.0], 1.0)
    wait_for(lambda: time.monotonic() > last, "the last setpoint's time")

    def stopped() -> bool:
        """What stops it is the driver's own command (docs/devices-wrist.md; how soon is measured by
        benchmarks/wrist_link.py).
        """
        times, _, _, modes = robot.motion()
        done = {mode for mode, t in zip(modes, times, strict=True) if t > begun}
        return "stopl" in done and robot.status()["mode"] == "hold"

    wait_for(stopped, "the arm at rest")
    at_rest = time.monotonic()
    wait_for(lambda: robot.motion()[0][-1] > at_rest, "the log of the motion")
    times, position, velocity, _ = robot.motion()
    speed = np.linalg.norm(velocity, axis=1)
    assert np.max(speed[times > begun]) > 0.1, "it moved with the stream"
    # Neither the controller's watchdog stopped it nor the end of the path.
    assert robot.status()["events"].get("watchdog", 0) == tripped
    after = times > at_rest
    assert np.max(speed[after]) < 5e-3
    assert np.ptp(position[after, 0]) < 1e-4, "it stays where it stopped"


def test_bad_setpoints_are_rejected_and_the_rest_still_works(driver: UrDriver) -> None:
    before = driver.counts["rejected"]
    for bad, why in (
        (WristSetpoint(np.full(3, np.nan), np.zeros(3), np.zeros(6)), "not finite"),
        (
            WristSetpoint(np.array([0.0, 0.3, 1.5]), np.zeros(3), np.zeros(6)),
            "outside the workspace",
        ),
    ):
        with pytest.raises(CommandRejectedError, match=why):
            driver.write(bad)
    assert driver.counts["rejected"] == before + 2
    sent = driver.write(hold(driver))
    assert sent.position == pytest.approx(hold(driver).position, abs=2e-3)


def test_a_jump_is_clamped_and_said_so(driver: UrDriver) -> None:
    start = hold(driver).position
    sent = driver.write(WristSetpoint(start + np.array([0.05, 0.0, 0.0]), np.zeros(3), np.zeros(6)))
    assert sent.position[0] - start[0] < 0.01
    assert driver.last_clamp
    wait_for(lambda: not driver.latest().servoing, "the stale stop")  # type: ignore[union-attr]


@pytest.mark.parametrize("rate", [20.0, 500.0])
def test_a_rate_that_is_not_the_controllers_is_refused(robot: EmulatedUr, rate: float) -> None:
    """Its limits would be those of other cycles: at 20 Hz 40 mm in one."""
    driver = UrDriver(config_for(robot.host, rate=rate))
    with pytest.raises(DeviceUnavailableError, match="125 cycles a second"):
        driver.connect()


def test_stop_holds_until_recover(driver: UrDriver) -> None:
    driver.stop()
    with pytest.raises(CommandRejectedError, match="stopped on request"):
        driver.write(hold(driver))
    wait_for(lambda: driver.health().level is HealthLevel.WARN, "the stop to be reported")
    recovers(driver)
    moves(driver, [0.0, 0.0, 0.002])


def test_no_setpoint_that_is_being_written_follows_a_stop(
    driver: UrDriver, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It would wake the arm once more, up to 0.2 s after the stop."""
    sent: list[bytes] = []
    send, stop = driver._supervisor.send, threading.Thread(target=driver.stop)

    def noted(message: bytes) -> bool:
        if message[:1] == SETPOINT:
            stop.start()
            stop.join(0.5)  # it comes first if nothing holds it up
        sent.append(message[:1])
        return send(message)

    monkeypatch.setattr(driver._supervisor, "send", noted)
    driver.write(hold(driver))
    stop.join()
    assert sent == [SETPOINT, HALT]
    monkeypatch.undo()
    recovers(driver)


def test_a_stop_outlasts_a_recovery_that_was_under_way(driver: UrDriver, robot: EmulatedUr) -> None:
    robot.fault("pstop")
    wait_for(lambda: "PROTECTIVE_STOP" in driver.health().message, "protective stop reported")
    said: list[str] = []

    def outlasted() -> bool:
        """Whether nothing but the stop was in the way: a recovery that lost its link on the way is
        asked for again.
        """
        answers: list[tuple[bool, str]] = []
        driver.recover(lambda ok, text: answers.append((ok, text)))
        driver.stop()
        wait_for(lambda: answers, "the end of the recovery")
        ((ok, text),) = answers
        assert not ok
        said.append(text)
        return "stopped on request meanwhile" in text

    wait_for(outlasted, lambda: f"a recovery to its end: {said}")
    wait_for(lambda: robot.status()["program"] == "PLAYING", "an arm that could move")
    with pytest.raises(CommandRejectedError, match="stopped on request"):
        driver.write(hold(driver))
    recovers(driver)
    wait_for(lambda: ready(driver), "ready again")


def test_protective_stop_is_reported_and_recovered(driver: UrDriver, robot: EmulatedUr) -> None:
    robot.fault("pstop")
    wait_for(
        lambda: driver.latest().safety is SafetyState.PROTECTIVE_STOP, "protective stop reported"
    )  # type: ignore[union-attr]
    wait_for(lambda: "PROTECTIVE_STOP" in driver.health().message, "its message")
    with pytest.raises(CommandRejectedError, match="call recover"):
        driver.write(hold(driver))
    recovers(driver)
    assert robot.status()["safety"] == "NORMAL"
    wait_for(lambda: ready(driver), "ready again")
    moves(driver, [0.0, 0.0, 0.002])


def test_emergency_stop_needs_the_button_released_first(
    driver: UrDriver, robot: EmulatedUr
) -> None:
    robot.fault("estop")
    wait_for(
        lambda: driver.latest().safety is SafetyState.EMERGENCY_STOP, "emergency stop reported"
    )  # type: ignore[union-attr]
    refusal = (False, "emergency stop: release the button, then recover again")
    wait_for(lambda: recover(driver) == refusal, "the button to be asked for")
    robot.fault("unlock")
    recovers(driver)
    wait_for(lambda: ready(driver), "ready again")
    moves(driver, [0.0, 0.0, -0.002])


def test_a_dead_program_is_reported_and_restarted(driver: UrDriver, robot: EmulatedUr) -> None:
    robot.fault("killprog")
    wait_for(lambda: not driver.latest().program_running, "program reported dead")  # type: ignore[union-attr]
    wait_for(lambda: "program does not run" in driver.health().message, "its message")
    recovers(driver)
    wait_for(lambda: ready(driver), "ready again")


def test_a_program_that_was_ended_at_the_pendant_stays_so_when_the_link_drops(
    driver: UrDriver, robot: EmulatedUr
) -> None:
    robot.fault("killprog")
    wait_for(lambda: not driver.latest().program_running, "program reported dead")  # type: ignore[union-attr]
    restarts, began = driver.health().values["restarts"], robot.status()["events"]["program_start"]
    robot.fault("drop")
    wait_for(lambda: driver.health().values["restarts"] != restarts, "loss noticed")
    wait_for(lambda: "program does not run" in driver.health().message, "the link back")
    assert robot.status()["events"]["program_start"] == began
    recovers(driver)
    wait_for(lambda: ready(driver), "ready again")


def test_a_program_that_our_own_delay_ended_is_started_again(
    driver: UrDriver, robot: EmulatedUr
) -> None:
    before = robot.status()["events"]
    pid = driver.process_id
    assert pid is not None
    os.kill(pid, signal.SIGSTOP)  # so the first state that it sees afterwards is: stopped
    try:
        wait_for(lambda: robot.status()["program"] == "STOPPED", "the watchdog's stop")
    finally:
        goes_on(pid)
    wait_for(lambda: robot.status()["program"] == "PLAYING", "the program started again")
    after = robot.status()["events"]
    assert after["watchdog"] > before.get("watchdog", 0)
    assert after["program_start"] > before["program_start"]
    wait_for(lambda: ready(driver), "ready again")
    moves(driver, [0.0, 0.0, 0.002])


@pytest.mark.parametrize("ahead", [0.0, 0.05])
def test_whoever_was_held_up_catches_up_within_the_speed_limit(
    driver: UrDriver, ahead: float
) -> None:
    """The setpoints of 70 ms became one step, at 1.1 m/s, and the controller's protective stop."""
    moves(driver, [0.0, 0.0, 0.002])
    start, pid, limits = hold(driver).position, driver.process_id, driver.config.limits
    assert pid is not None
    speeds, states, begun = [0.0], {SafetyState.NORMAL}, time.monotonic()
    held = 0
    try:
        while (t := time.monotonic() - begun) < 0.6:
            if held == 0 and t > 0.15:
                os.kill(pid, signal.SIGSTOP)
                held = 1
            elif held == 1 and t > 0.22:
                goes_on(pid)
                held = 2
            at = t + ahead  # 0.6 m/s soon, and 0.12 m far
            x = 0.06 * (1.0 - math.cos(min(at / 0.3, 1.0) * math.pi))
            setpoint = WristSetpoint(
                start + np.array([x, 0.0, 0.0]), np.zeros(3), np.zeros(6), time.time() + ahead
            )
            with contextlib.suppress(*REFUSED):
                driver.write(setpoint)
            reading = driver.latest()
            assert reading is not None
            speeds.append(math.hypot(*reading.twist[:3]))
            states.add(reading.safety)
            time.sleep(0.004)
    finally:
        goes_on(pid)
    assert states == {SafetyState.NORMAL}
    assert max(speeds) < 1.15 * limits.speed  # a servo swings over
    moves(driver, (start - hold(driver).position).tolist())


@pytest.mark.parametrize("fault", ["drop", "drop rst"])
def test_a_dropped_link_comes_back(driver: UrDriver, robot: EmulatedUr, fault: str) -> None:
    restarts = driver.health().values["restarts"]
    robot.fault(fault)
    wait_for(lambda: driver.health().values["restarts"] != restarts, "loss noticed")
    wait_for(lambda: ready(driver), "link back")
    moves(driver, [0.002, 0.0, 0.0])


def test_a_silent_controller_is_noticed_and_comes_back(driver: UrDriver, robot: EmulatedUr) -> None:
    robot.fault("stall")
    wait_for(lambda: driver.health().level is HealthLevel.ERROR, "silence noticed")
    with pytest.raises(DeviceUnavailableError):
        driver.write(hold(driver))
    robot.fault("resume")
    wait_for(lambda: ready(driver), "link back")


def test_a_refusing_controller_is_retried(driver: UrDriver, robot: EmulatedUr) -> None:
    robot.fault("refuse")
    robot.fault("drop")
    wait_for(lambda: "refused" in driver.health().message, "refusal reported")
    robot.fault("accept")
    wait_for(lambda: ready(driver), "link back")


def test_the_drivers_process_can_be_killed(driver: UrDriver, robot: EmulatedUr) -> None:
    pid = driver.process_id
    assert pid is not None
    os.kill(pid, signal.SIGKILL)
    wait_for(
        lambda: driver.process_id not in (pid, None) and ready(driver), "another process at work"
    )
    moves(driver, [-0.002, 0.0, 0.0])


def test_a_hanging_process_is_replaced(driver: UrDriver) -> None:
    pid = driver.process_id
    assert pid is not None
    os.kill(pid, signal.SIGSTOP)
    wait_for(
        lambda: driver.process_id not in (pid, None) and ready(driver), "another process at work"
    )
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_e_series_runs_at_its_own_rate(tmp_path: Path) -> None:
    stamps: list[float] = []
    with EmulatedUr(tmp_path, "e-series") as robot:
        driver = UrDriver(
            config_for(robot.host),
            on_reading=lambda reading: stamps.append(reading.controller_time),
        )
        driver.connect()
        try:
            assert driver.health().values["rate_hz"] == 500.0
            moves(driver, [0.0, 0.015, 0.0])
            cycles = np.diff(stamps) / 0.002
            assert cycles == pytest.approx(np.round(cycles), abs=1e-3)
            assert np.min(cycles) == pytest.approx(1.0), "no state of every cycle was ever seen"
        finally:
            driver.close()
        wait_for(lambda: robot.status()["program"] == "STOPPED", "program ended with the driver")


def test_nobody_there_is_one_clear_error() -> None:
    driver = UrDriver(config_for(loopback_address()))
    with pytest.raises(
        DeviceUnavailableError, match=r"RTDE port 127\..*:30004 \(Connection refused\).*link\.host"
    ):
        driver.connect()
    assert driver.process_id is None


def test_an_unknown_host_name_is_one_clear_error() -> None:
    with pytest.raises(DeviceUnavailableError, match="not a known host name"):
        UrDriver(config_for("no-such-robot.invalid")).connect()


def test_something_else_on_the_port_is_one_clear_error() -> None:
    host = loopback_address()
    with socket.create_server((host, 30004)) as listener:

        def answer() -> None:
            connection, _ = listener.accept()
            with connection:
                connection.recv(64)
                connection.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")

        threading.Thread(target=answer, daemon=True).start()
        with pytest.raises(DeviceUnavailableError, match="does not speak RTDE"):
            UrDriver(config_for(host)).connect()


def test_a_controller_that_accepts_and_says_nothing_is_one_clear_error() -> None:
    host = loopback_address()
    with (
        socket.create_server((host, 30004)),
        pytest.raises(DeviceUnavailableError, match="does not answer within 2 s"),
    ):
        UrDriver(config_for(host)).connect()
