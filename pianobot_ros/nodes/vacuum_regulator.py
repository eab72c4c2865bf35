"""``vacuum_regulator``: the vacuum of the fingers, real or emulated.

Subscribes to ``/command/vacuum``, publishes ``/real/vacuum/state`` with every report of the device (100 Hz), offers ``~/vent``,
and vents at an emergency stop of the arm and at shutdown if the parameters say so.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

from pianobot_msgs.msg import VacuumCommand, VacuumState, WristState
from std_srvs.srv import Trigger

from pianobot_ros.cell.errors import unknown_name
from pianobot_ros.devices.base import CommandRejectedError, DeviceUnavailableError
from pianobot_ros.devices.regulator import (
    RegulatorConfig,
    RegulatorDriver,
    VacuumReading,
    VacuumSetpoint,
    load_config,
)
from pianobot_ros.nodes import common
from pianobot_ros.nodes.common import Health, HealthLevel
from pianobot_ros.nodes.polled import PolledSubscription, Watch, stream_qos
from pianobot_ros.nodes.template import Template

__all__ = ["VacuumRegulator", "main"]

_LOG_PERIOD = 1.0  # s between two log lines about bad commands
ARM_PERIOD = 0.05  # s between two looks at the arm's safety state


class VacuumRegulator(common.DeviceNode):
    """The lifecycle node; a thin shell around :class:`RegulatorDriver`."""

    def __init__(self, **options: Any) -> None:
        super().__init__("vacuum_regulator", **options)
        common.declare(self, "config", "regulator.yaml", "file with port, fingers and limits of the regulator")
        self._file_config = config = load_config(self.get_parameter("config").value)
        common.declare(self, "port", config.link.port, "serial port of the regulator")
        common.declare(self, "baud", config.link.baud, "Bd of the port", low=300, high=4_000_000)
        common.declare(
            self, "lowest", config.limits.lowest, "Pa gauge, deepest vacuum that is sent", low=-101_325.0, high=0.0
        )
        common.declare(
            self, "stale_time", 0.5, "s, a command whose stamp is older is not obeyed; 0 obeys all", low=0.0, high=60.0
        )
        common.declare(self, "vent_on_shutdown", True, "let the vacuum go when the node is deactivated or ends")
        common.declare(self, "vent_on_estop", True, "let the vacuum go at an emergency stop of the arm")
        self._driver: RegulatorDriver | None = None
        self._inputs: list[Any] = []
        self._names: list[str] = []
        self._estop = False
        self._arm: Watch | None = None

    def _config(self) -> RegulatorConfig:
        config = self._file_config
        link = {"port": self.get_parameter("port").value, "baud": self.get_parameter("baud").value}
        limits = {"lowest": self.get_parameter("lowest").value}
        return config.model_copy(
            update={"link": config.link.model_copy(update=link), "limits": config.limits.model_copy(update=limits)}
        )

    # Lifecycle.

    def setup(self) -> None:
        """Open the port and identify the device."""
        config = self._config()
        self._names = list(config.fingers)
        self.diagnostics.hardware_id = config.link.port
        topic = "/real/vacuum/state"
        self._states = self.create_lifecycle_publisher(
            VacuumState, topic, common.SENSOR_QOS, event_callbacks=common.publisher_events(self, topic)
        )
        nothing = [0.0] * len(self._names)
        state = VacuumState(fingers=self._names, setpoint=nothing, measured=nothing)
        self._state_bytes = Template(state, setpoint=f"{len(nothing)}d", measured=f"{len(nothing)}d", sequence="I")
        self._vent_service = self.create_service(Trigger, "~/vent", self._on_vent)
        self._driver = RegulatorDriver(config, self._publish, self._on_event)
        self._driver.connect()

    def start(self) -> None:
        """Obey commands from now on."""
        self._estop = False
        self._inputs = [
            self.create_subscription(
                VacuumCommand,
                "/command/vacuum",
                self._on_command,
                common.COMMAND_QOS,
                event_callbacks=common.subscription_events(self, "/command/vacuum"),
            )
        ]
        if self.get_parameter("vent_on_estop").value:
            # Looked at twenty times a second: to be woken by each of the arm's messages costs more than the regulator itself.
            states = PolledSubscription(self, WristState, "/real/wrist/state", stream_qos(1))
            self._arm = Watch(states, self._look_at_arm, ARM_PERIOD)

    def stop(self) -> None:
        """Stop obeying; vent if ``vent_on_shutdown``."""
        for subscription in self._inputs:
            self.destroy_subscription(subscription)
        self._inputs = []
        if self._arm is not None:
            self._arm.close()
            self._arm = None
        if self.get_parameter("vent_on_shutdown").value:
            self._vent()

    def release(self) -> None:
        """Release the port and take down service and publisher."""
        if self._driver is not None:
            self._driver.close(vent=bool(self.get_parameter("vent_on_shutdown").value))
            self._driver = None
        for name, destroy in (("_vent_service", self.destroy_service), ("_states", self.destroy_lifecycle_publisher)):
            if (entity := getattr(self, name, None)) is not None:
                destroy(entity)
                setattr(self, name, None)

    def diagnose(self) -> Mapping[str, Health]:
        """Link and regulation."""
        if self._driver is None:
            return {"regulator": Health(HealthLevel.STALE, self._last_failure or self.state)}
        health = self._driver.health()
        values = {**health.values, "lifecycle": self.state, "emergency_stop": int(self._estop)}
        return {"regulator": Health(health.level, health.message, health.age_s, values)}

    # Topics and services.

    def _on_command(self, message: VacuumCommand) -> None:
        driver = self._driver
        if driver is None:
            return
        try:
            wanted = self._setpoint(message, driver)
            sent = driver.write(wanted)
        except CommandRejectedError as error:
            self.get_logger().warning(f"command rejected: {error}", throttle_duration_sec=_LOG_PERIOD)
        except DeviceUnavailableError as error:
            self.get_logger().warning(f"command waits: {error}", throttle_duration_sec=_LOG_PERIOD)
        else:
            off = max(abs(a - b) for a, b in zip(sent.pressure, wanted.pressure, strict=True))
            if off > 1.0:
                self.get_logger().warning(
                    f"command clipped by {off:.0f} Pa to the range in regulator.yaml", throttle_duration_sec=_LOG_PERIOD
                )

    def _setpoint(self, message: VacuumCommand, driver: RegulatorDriver) -> VacuumSetpoint:
        """All channels, those that the command does not name as they were. Raises CommandRejectedError."""
        if self._estop:
            raise CommandRejectedError("the arm is in emergency stop and vent_on_estop is set")
        if len(message.fingers) != len(message.pressure) or not message.fingers:
            raise CommandRejectedError(
                f"{len(message.fingers)} fingers but {len(message.pressure)} pressures: give one pressure to each finger"
            )
        if len(set(message.fingers)) != len(message.fingers):
            raise CommandRejectedError(f"a finger is named twice: {', '.join(message.fingers)}")
        stamp = common.seconds(message.header.stamp)
        limit = self.get_parameter("stale_time").value
        if stamp > 0.0 and limit > 0.0 and (age := time.time() - stamp) > limit:
            raise CommandRejectedError(f"it is {age:.2f} s old (stale_time is {limit:g} s): are the clocks equal?")
        target = dict(zip(self._names, driver.target.pressure, strict=True))
        for finger, pressure in zip(message.fingers, message.pressure, strict=True):
            if finger not in target:
                raise CommandRejectedError(unknown_name("finger", finger, self._names))
            target[finger] = pressure
        a, b, c = target.values()
        return VacuumSetpoint((a, b, c))

    def _look_at_arm(self, message: WristState) -> None:
        estop = message.safety_state == WristState.SAFETY_EMERGENCY_STOP
        if estop and not self._estop:
            self.get_logger().error("emergency stop of the arm: venting the fingers")
            self._vent()
        self._estop = estop

    def _on_vent(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self._vent()
        response.message = "vented" if response.success else "the regulator is away; it vents when it is back"
        return response

    def _vent(self) -> bool:
        if self._driver is None:
            return False
        try:
            self._driver.vent()
        except DeviceUnavailableError:
            return False
        return True

    def _publish(self, reading: VacuumReading) -> None:
        # On the driver's thread, so that a report never waits for a callback of the executor.
        self._states.publish(
            self._state_bytes.fill(
                reading.time_ns,
                setpoint=reading.setpoint,
                measured=reading.measured,
                sequence=reading.sequence & 0xFFFFFFFF,
            )
        )

    def _on_event(self, level: HealthLevel, text: str) -> None:
        # rclpy wants one severity for each calling line.
        if level is HealthLevel.OK:
            self.get_logger().info(text)
        else:
            self.get_logger().error(text)


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    return common.run(VacuumRegulator, arguments, pace=common.PACE - 1)


if __name__ == "__main__":
    sys.exit(main())
