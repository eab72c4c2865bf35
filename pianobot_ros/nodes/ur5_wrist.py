"""``ur5_wrist``: the UR5 that carries the hand, real or emulated.

Subscribes to ``/command/wrist``, publishes ``/real/wrist/state`` and ``/real/joint_states`` with every package of the
controller, and offers ``~/stop`` and ``~/recover``. Limits, validation and the stale stop are in the driver.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pianobot_msgs.msg import WristCommand, WristState
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.devices.base import CommandRejectedError, DeviceUnavailableError
from pianobot_ros.devices.ur import UrConfig, UrDriver, WristReading, WristSetpoint, load_config
from pianobot_ros.devices.ur.rotations import quaternion, rotation_vector
from pianobot_ros.devices.ur.types import Array
from pianobot_ros.nodes import common
from pianobot_ros.nodes.common import Health, HealthLevel
from pianobot_ros.nodes.polled import PolledSubscription, Watch, stream_qos
from pianobot_ros.nodes.template import Template

__all__ = ["JOINT_NAMES", "Ur5Wrist", "main"]

JOINT_NAMES = [
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
]

_LOG_PERIOD = 1.0  # s between two log lines about bad commands
COMMAND_PERIOD = 0.002  # s between two looks for commands
COMMANDS = 64  # setpoints that may wait; sent ahead, none of them is superfluous


class Ur5Wrist(common.DeviceNode):
    """The lifecycle node; a thin shell around :class:`UrDriver`."""

    def __init__(self, **options: Any) -> None:
        super().__init__("ur5_wrist", **options)
        common.declare(self, "config", "wrist.yaml", "file with address, mount, limits and workspace of the arm")
        config = load_config(self.get_parameter("config").value)
        self._declare_overrides(config)
        self._driver: UrDriver | None = None
        self._commands: Watch | None = None

    def _declare_overrides(self, config: UrConfig) -> None:
        """What one may want to change without another file; the defaults come from the file."""
        link, limits, servo = config.link, config.limits, config.servo
        common.declare(self, "host", link.host, "IP address of the controller, or loopback for the emulated one")
        common.declare(self, "rate", link.rate, "Hz of the controller; 0 asks it", low=0.0, high=500.0)
        common.declare(self, "speed_limit", limits.speed, "m/s, largest speed of the wrist", low=0.01, high=3.0)
        common.declare(
            self,
            "acceleration_limit",
            limits.acceleration,
            "m/s^2, largest acceleration of the wrist",
            low=0.1,
            high=100.0,
        )
        common.declare(self, "stale_time", limits.stale, "s without a setpoint that stop the arm", low=0.008, high=0.04)
        common.declare(self, "lookahead", servo.lookahead, "s, smoothing of servoL", low=0.03, high=0.2)
        common.declare(self, "gain", servo.gain, "proportional gain of servoL", low=100.0, high=2000.0)
        common.declare(self, "frame_id", "base", "frame of the poses")
        self._file_config = config

    def _config(self) -> UrConfig:
        def value(name: str) -> Any:
            return self.get_parameter(name).value

        config = self._file_config
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
                "servo": config.servo.model_copy(update={"lookahead": value("lookahead"), "gain": value("gain")}),
            }
        )

    # Lifecycle.

    def setup(self) -> None:
        """Connect to the controller."""
        config = self._config()
        if not config.link.host:
            raise ConfigError("parameter 'host' is empty: set it to the controller's address")
        self.diagnostics.hardware_id = config.link.host
        self._frame = str(self.get_parameter("frame_id").value)
        self._states = self.create_lifecycle_publisher(
            WristState,
            "/real/wrist/state",
            common.SENSOR_QOS,
            event_callbacks=common.publisher_events(self, "/real/wrist/state"),
        )
        self._joints = self.create_lifecycle_publisher(
            JointState,
            "/real/joint_states",
            common.SENSOR_QOS,
            event_callbacks=common.publisher_events(self, "/real/joint_states"),
        )
        self._make_templates()
        self._stop_service = self.create_service(Trigger, "~/stop", self._on_stop)
        self._recover_service = self.create_service(
            # A recovery takes seconds: in the default group it would keep every other callback out.
            Trigger,
            "~/recover",
            self._on_recover,
            callback_group=ReentrantCallbackGroup(),
        )
        self._driver = UrDriver(config, self._publish, self._on_event)
        self._driver.connect()

    def _make_templates(self) -> None:
        state = WristState()
        state.header.frame_id = self._frame
        self._state_bytes = Template(
            state, pose="7d", twist="6d", target_pose="7d", joint_currents="6d", controller_time="d", speed_scaling="d",
            safety_state="B", program_running="?",
        )  # fmt: skip
        joints = JointState(name=JOINT_NAMES, position=[0.0] * 6, velocity=[0.0] * 6)
        joints.header.frame_id = self._frame
        self._joint_bytes = Template(joints, position="6d", velocity="6d")

    def start(self) -> None:
        """Obey commands from now on."""
        stream = PolledSubscription(self, WristCommand, "/command/wrist", stream_qos(COMMANDS, reliable=True))
        self._commands = Watch(stream, self._on_command, COMMAND_PERIOD)

    def stop(self) -> None:
        """Stop obeying; the driver stops the arm once the stream is stale."""
        if self._driver is not None:
            self._driver.rest()
        if self._commands is not None:
            self._commands.close()
            self._commands = None

    def release(self) -> None:
        """Bring the arm to rest, disconnect, and take down services and publishers."""
        if self._driver is not None:
            self._driver.close()
            self._driver = None
        for name, destroy in (
            ("_stop_service", self.destroy_service),
            ("_recover_service", self.destroy_service),
            ("_states", self.destroy_lifecycle_publisher),
            ("_joints", self.destroy_lifecycle_publisher),
        ):
            if (entity := getattr(self, name, None)) is not None:
                destroy(entity)
                setattr(self, name, None)

    def diagnose(self) -> Mapping[str, Health]:
        """Link and arm."""
        if self._driver is None:
            return {"arm": Health(HealthLevel.STALE, self._last_failure or self.state)}
        health = self._driver.health()
        values = {**health.values, "lifecycle": self.state}
        return {"arm": Health(health.level, health.message, health.age_s, values)}

    # Topics.

    def _on_command(self, message: WristCommand) -> None:
        driver = self._driver
        if driver is None:
            return
        setpoint = _setpoint(message)
        try:
            sent = driver.write(setpoint)
        except CommandRejectedError as error:
            self.get_logger().warning(f"command rejected: {error}", throttle_duration_sec=_LOG_PERIOD)
        except DeviceUnavailableError as error:
            self.get_logger().warning(f"command lost: {error}", throttle_duration_sec=_LOG_PERIOD)
        else:
            if driver.last_clamp:
                off = 1e3 * float(np.linalg.norm(sent.position - setpoint.position))
                self.get_logger().warning(
                    f"command clamped by the {driver.last_clamp} limit, {off:.1f} mm short (limits in wrist.yaml)",
                    throttle_duration_sec=_LOG_PERIOD,
                )

    def _publish(self, reading: WristReading) -> None:
        # On the driver's thread, so that a state never waits for a callback of the executor.
        self._states.publish(
            self._state_bytes.fill(
                reading.time_ns, pose=_pose(reading.position, reading.rotation), twist=reading.twist.tolist(),
                target_pose=_pose(reading.target_position, reading.target_rotation), joint_currents=reading.currents.tolist(),
                controller_time=reading.controller_time, speed_scaling=reading.speed_scaling,
                safety_state=int(reading.safety), program_running=reading.program_running,
            )
        )  # fmt: skip
        self._joints.publish(
            self._joint_bytes.fill(reading.time_ns, position=reading.q.tolist(), velocity=reading.qd.tolist())
        )

    def _on_event(self, level: HealthLevel, text: str) -> None:
        # While configuring, the failure is logged by the transition itself.
        if self.state == "active" or level is HealthLevel.OK:
            self._log(level, text)
            self.diagnostics.publish()  # now: the link may be back before the next report

    def _log(self, level: HealthLevel, text: str) -> None:
        # A line each: rclpy allows one severity for each place in the code.
        if level is HealthLevel.OK:
            self.get_logger().info(text)
        elif level is HealthLevel.WARN:
            self.get_logger().warning(text)
        else:
            self.get_logger().error(text)

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
            executor.wake()  # this comes from the driver's thread, which the executor does not watch

        self._driver.recover(finish)
        response.success, response.message = await finished
        self._log(HealthLevel.OK if response.success else HealthLevel.ERROR, f"recover: {response.message}")
        return response


def _setpoint(message: WristCommand) -> WristSetpoint:
    p, q, v, w = message.pose.position, message.pose.orientation, message.twist.linear, message.twist.angular
    # What is no rotation becomes not a number, which the driver rejects and counts.
    unit = abs(math.hypot(q.x, q.y, q.z, q.w) - 1.0) < 0.01
    rotation = np.array(rotation_vector((q.x, q.y, q.z, q.w))) if unit else np.full(3, np.nan)
    return WristSetpoint(
        position=np.array([p.x, p.y, p.z]),
        rotation=rotation,
        velocity=np.array([v.x, v.y, v.z, w.x, w.y, w.z]),
        stamp=common.seconds(message.header.stamp),
    )


def _pose(position: Array, rotation: Array) -> list[float]:
    """Position and quaternion (x, y, z, w) of a position and a rotation vector."""
    return [*position.tolist(), *quaternion(rotation.tolist())]


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    return common.run(Ur5Wrist, arguments, pace=common.PACE)


if __name__ == "__main__":
    sys.exit(main())
