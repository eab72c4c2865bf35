"""``ur5_wrist``: the UR5 that carries the hand, real or emulated.

Subscribes to ``/command/wrist``, publishes ``/real/wrist/state`` and ``/real/joint_states`` with
every package of the controller, and offers ``~/stop`` and ``~/recover``. Limits, validation and the
stale stop are in the driver.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pianobot_msgs.msg import WristCommand, WristState
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.cell.host.marks import Mark
from pianobot_ros.cell.host.wall_clock import AHEAD
from pianobot_ros.cell.messages.command_checks import wrist_setpoint
from pianobot_ros.cell.messages.stamps import first_stamp
from pianobot_ros.cell.messages.wrist_order import WristOrder
from pianobot_ros.cell.motion.rotations import quaternion
from pianobot_ros.devices.wrist.config import UrConfig
from pianobot_ros.devices.wrist.driver import UrDriver
from pianobot_ros.devices.wrist.wrist_reading import Vector, WristReading
from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.base.common import Health, HealthLevel
from pianobot_ros.nodes.session.refused_commands import RefusalPublisher
from pianobot_ros.nodes.topics.polled import Taken
from pianobot_ros.nodes.topics.template import Template

__all__ = ["JOINT_NAMES", "Ur5Wrist", "main", "pause_after"]

JOINT_NAMES = [
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
]

_LOG_PERIOD = 1.0  # s between two log lines about bad commands
COMMAND_PERIOD = 0.004  # s between two looks for commands
STREAM_PERIOD = 0.008  # the same while they come so early that a look costs none its time:
EARLY = 0.03  # s before it; half of it is left when the arm's driver has the setpoint
COMMANDS = 64  # setpoints that may wait; sent ahead, none of them is superfluous


class Ur5Wrist(common.DeviceNode):
    """The lifecycle node; a thin shell around :class:`UrDriver`."""

    def __init__(self, **options: Any) -> None:
        super().__init__("ur5_wrist", **options)
        self._file_config = self.load_config(
            UrConfig, "address, mount, limits and workspace of the arm"
        )
        _declare_overrides(self, self._file_config)
        self._driver: UrDriver | None = None
        self._refusals = RefusalPublisher(self, "real")

    # Lifecycle.

    def setup(self) -> None:
        """Connect to the controller."""
        config = _overridden(self, self._file_config)
        if not config.link.host:
            raise ConfigError("parameter 'host' is empty: set it to the controller's address")
        self.diagnostics.hardware_id = config.link.host
        self._frame = str(self.get_parameter("frame_id").value)
        self._states = self.add_publisher(WristState, "/real/wrist/state", common.SENSOR_QOS)
        self._joints = self.add_publisher(JointState, "/real/joint_states", common.SENSOR_QOS)
        self._make_templates()
        self.add_service(Trigger, "~/stop", self._on_stop)
        # A recovery takes seconds: in the default group it would keep every other callback out.
        self.add_service(Trigger, "~/recover", self._on_recover, ReentrantCallbackGroup())
        stopped, ended = self._marks()
        self._driver = UrDriver(config, self._publish, self.on_event, stopped=stopped, ended=ended)
        self._driver.connect()

    def _make_templates(self) -> None:
        state = WristState()
        state.header.frame_id = self._frame
        self._state_bytes = Template(
            state,
            pose="7d",
            twist="6d",
            target_pose="7d",
            joint_currents="6d",
            controller_time="d",
            speed_scaling="d",
            safety_state="B",
            program_running="?",
        )
        joints = JointState(name=JOINT_NAMES, position=[0.0] * 6, velocity=[0.0] * 6)
        joints.header.frame_id = self._frame
        self._joint_bytes = Template(joints, position="6d", velocity="6d")

    def start(self) -> None:
        """Obey commands from now on."""
        self.add_watch(
            WristCommand,
            "/command/wrist",
            self._on_command,
            pause_after,
            depth=COMMANDS,
            reliable=True,
            read=lambda taken: taken,
        )

    def stop(self) -> None:
        """Bring the arm to rest."""
        if self._driver is not None:
            self._driver.rest()

    def _marks(self) -> list[Mark]:
        """That the arm was stopped on request, and that its program was ended: both outlast the
        driver, and this process if that is killed.
        """
        arm = f"{self.context.get_domain_id()}-{self.get_parameter('host').value}"
        return [Mark(f"{what}-{arm}") for what in ("stopped", "ended")]

    def shut_down(self) -> None:
        """End in order: whoever starts the node anew decides anew."""
        super().shut_down()
        for mark in self._marks():
            mark.set(False)

    def diagnose(self) -> Mapping[str, Health]:
        """Link and arm."""
        said = self._refusals
        return self.health_of(
            "arm", self._driver, rejected=said.count, last_refusal=said.last, behind=said.late
        )

    # Topics.

    def _on_command(self, taken: Taken) -> None:
        driver = self._driver
        if driver is None:
            return
        stamp = common.stamp_of(taken.data)
        with self._refusals.of_driver("/command/wrist", stamp, "it is lost"):
            setpoint = wrist_setpoint(WristOrder.read(taken.data), self._frame, time.time())
            sent = driver.write(setpoint)
            if driver.last_clamp:
                self._refusals.clamped("/command/wrist", stamp, driver.last_clamp)
                off = 1e3 * float(np.linalg.norm(sent.position - setpoint.position))
                self.get_logger().warning(
                    f"command clamped by the {driver.last_clamp} limit, {off:.1f} mm short (limits"
                    " in wrist.yaml)",
                    throttle_duration_sec=_LOG_PERIOD,
                )

    def _publish(self, reading: WristReading) -> None:
        # On the driver's thread, so that a state never waits for a callback of the executor.
        self._refusals.behind("/command/wrist", reading.time_ns, reading.behind)
        self._states.publish(
            self._state_bytes.fill(
                reading.time_ns,
                pose=_pose(reading.position, reading.rotation),
                twist=reading.twist,
                target_pose=_pose(reading.target_position, reading.target_rotation),
                joint_currents=reading.currents,
                controller_time=reading.controller_time,
                speed_scaling=reading.speed_scaling,
                safety_state=int(reading.safety),
                program_running=reading.program_running,
            )
        )
        self._joints.publish(
            self._joint_bytes.fill(reading.time_ns, position=reading.q, velocity=reading.qd)
        )

    def on_event(self, level: HealthLevel, text: str) -> None:
        """Log what the driver reports, and publish the diagnosis at once: the link may be back
        before the next report.
        """
        # While configuring, the failure is logged by the transition itself.
        if self.state == "active" or level is HealthLevel.OK:
            super().on_event(level, text)
            self.diagnostics.publish()

    # Services.

    def _on_stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._driver is None:
            response.message = "not connected"
            return response
        self._driver.stop()
        response.success, response.message = True, "arm stopped; call recover to let it move again"
        return response

    async def _on_recover(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._driver is None:
            response.message = "not connected"
            return response
        executor = self.executor
        finished: Future = Future(executor=executor)

        def finish(ok: bool, text: str) -> None:
            finished.set_result((ok, text))
            # this comes from the driver's thread, which the executor does not watch
            executor.wake()

        self._driver.recover(finish)
        response.success, response.message = await finished
        super().on_event(
            HealthLevel.OK if response.success else HealthLevel.ERROR,
            f"recover: {response.message}",
        )
        return response


def pause_after(found: Sequence[Taken], now_ns: int | None = None) -> float:
    """Until the next look for commands, s, when the last one has ``found`` these, ``now_ns`` (ns
    since the epoch; by default the clock's).

    Where nothing came, or anything that is to be obeyed at once, the next may be urgent.
    """
    if not found:
        return COMMAND_PERIOD
    now = time.time_ns() if now_ns is None else now_ns
    ahead = [1e-9 * (first_stamp(taken.data) - now) for taken in found]
    return STREAM_PERIOD if min(ahead) > EARLY and max(ahead) <= AHEAD else COMMAND_PERIOD


def _declare_overrides(node: common.DeviceNode, config: UrConfig) -> None:
    """What one may want to change without another file; the defaults come from the file."""
    link, limits, servo = config.link, config.limits, config.servo
    node.declare(
        "host", link.host, "IP address of the controller, or loopback for the emulated one"
    )
    node.declare(
        "rate", link.rate, "Hz of the controller, which refuses another; 0 asks it", 0.0, 500.0
    )
    node.declare("speed_limit", limits.speed, "m/s, largest speed of the wrist", 0.01, 3.0)
    node.declare(
        "acceleration_limit",
        limits.acceleration,
        "m/s^2, largest acceleration of the wrist",
        0.1,
        100.0,
    )
    node.declare("stale_time", limits.stale, "s without a setpoint that stop the arm", 0.008, 0.04)
    node.declare("lookahead", servo.lookahead, "s, smoothing of servoL", 0.03, 0.2)
    node.declare("gain", servo.gain, "proportional gain of servoL", 100.0, 2000.0)
    node.declare("frame_id", "base", "frame of the poses")


def _overridden(node: Node, config: UrConfig) -> UrConfig:
    """The configuration with what the parameters say put in."""

    def value(name: str) -> Any:
        return node.get_parameter(name).value

    return config.model_copy(
        update={
            "link": config.link.model_copy(update={"host": value("host"), "rate": value("rate")}),
            "limits": config.limits.model_copy(
                update={
                    "speed": value("speed_limit"),
                    "acceleration": value("acceleration_limit"),
                    "stale": value("stale_time"),
                }
            ),
            "servo": config.servo.model_copy(
                update={"lookahead": value("lookahead"), "gain": value("gain")}
            ),
        }
    )


def _pose(position: Vector, rotation: Vector) -> Vector:
    """Position and quaternion (x, y, z, w) of a position and a rotation vector."""
    return *position, *quaternion(rotation)


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    return common.run(Ur5Wrist, arguments, realtime=common.REALTIME_PRIORITY)


if __name__ == "__main__":
    sys.exit(main())
