"""``vacuum_regulator``: the vacuum of the fingers, real or emulated.

Subscribes to ``/command/vacuum``, publishes ``/real/vacuum/state`` with every report of the device
(100 Hz), offers ``~/vent``, and vents at an emergency stop of the arm and at shutdown if the
parameters say so.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Mapping, Sequence
from typing import Any

from pianobot_msgs.msg import VacuumCommand, VacuumState, WristState
from std_srvs.srv import Trigger

from pianobot_ros.cell.messages.command_checks import STALE, vacuum_setpoint
from pianobot_ros.devices.base import CommandRejectedError, DeviceUnavailableError
from pianobot_ros.devices.vacuum import (
    RegulatorConfig,
    RegulatorDriver,
    VacuumReading,
    VacuumSetpoint,
)
from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.base.common import Health
from pianobot_ros.nodes.session.refused_commands import RefusalPublisher
from pianobot_ros.nodes.topics.template import Template

__all__ = ["VacuumRegulator", "main"]

_LOG_PERIOD = 1.0  # s between two log lines about bad commands
ARM_PERIOD = 0.05  # s between two looks at the arm's safety state


class VacuumRegulator(common.DeviceNode):
    """The lifecycle node; a thin shell around :class:`RegulatorDriver`."""

    def __init__(self, **options: Any) -> None:
        super().__init__("vacuum_regulator", **options)
        self._file_config = config = self.load_config(
            RegulatorConfig, "port, fingers and limits of the regulator"
        )
        self.declare_port(config.link, "regulator")
        self.declare(
            "lowest", config.limits.lowest, "Pa gauge, deepest vacuum that is sent", -101_325.0, 0.0
        )
        self.declare(
            "stale_time",
            STALE,
            "s, a command whose stamp is older is not obeyed; 0 obeys all",
            0.0,
            60.0,
            changes="any",
        )
        self.declare(
            "vent_on_shutdown",
            True,
            "let the vacuum go when the node is deactivated or ends",
            changes="any",
        )
        self.declare("vent_on_estop", True, "let the vacuum go at an emergency stop of the arm")
        self._driver: RegulatorDriver | None = None
        self._names: list[str] = []
        self._estop, self._judging = False, threading.Lock()
        self._refusals = RefusalPublisher(self, "real")

    def _config(self) -> RegulatorConfig:
        config = self._file_config
        link = {"port": self.get_parameter("port").value, "baud": self.get_parameter("baud").value}
        limits = {"lowest": self.get_parameter("lowest").value}
        return config.model_copy(
            update={
                "link": config.link.model_copy(update=link),
                "limits": config.limits.model_copy(update=limits),
            }
        )

    # Lifecycle.

    def setup(self) -> None:
        """Open the port and identify the device."""
        config = self._config()
        self._names = list(config.fingers)
        self.diagnostics.hardware_id = config.link.port
        self._states = self.add_publisher(VacuumState, "/real/vacuum/state", common.SENSOR_QOS)
        nothing = [0.0] * len(self._names)
        state = VacuumState(fingers=self._names, setpoint=nothing, measured=nothing)
        self._state_bytes = Template(
            state, setpoint=f"{len(nothing)}d", measured=f"{len(nothing)}d", sequence="I"
        )
        self.add_service(Trigger, "~/vent", self._on_vent)
        self._driver = RegulatorDriver(config, self._publish, self.on_event)
        self._driver.connect()

    def start(self) -> None:
        """Obey commands from now on."""
        self._estop = False
        self.add_subscription(
            VacuumCommand, "/command/vacuum", self._on_command, common.COMMAND_QOS
        )
        if self.get_parameter("vent_on_estop").value:
            # Looked at twenty times a second: to be woken by each of the arm's messages costs more
            # than the regulator itself.
            self.add_watch(WristState, "/real/wrist/state", self._look_at_arm, ARM_PERIOD)

    def stop(self) -> None:
        """Vent if ``vent_on_shutdown``."""
        if self.get_parameter("vent_on_shutdown").value:
            self._vent()

    def release(self) -> None:
        """Release the port."""
        if self._driver is not None:
            self._driver.close(vent=bool(self.get_parameter("vent_on_shutdown").value))
            self._driver = None

    def diagnose(self) -> Mapping[str, Health]:
        """Link and regulation."""
        return self.health_of(
            "regulator",
            self._driver,
            rejected=self._refusals.count,
            emergency_stop=int(self._estop),
            last_refusal=self._refusals.last,
        )

    # Topics and services.

    def _on_command(self, message: VacuumCommand) -> None:
        driver = self._driver
        if driver is None:
            return
        stamp = message.header.stamp
        # no command that was judged before an emergency stop is written after it
        with self._refusals.of_driver("/command/vacuum", stamp, "it waits"), self._judging:
            wanted = self._setpoint(message, driver)
            sent = driver.write(wanted)
            off = max(abs(a - b) for a, b in zip(sent.pressure, wanted.pressure, strict=True))
            if off > 1.0:
                self._refusals.clamped("/command/vacuum", stamp, "vacuum")
                self.get_logger().warning(
                    f"command clipped by {off:.0f} Pa to the range in vacuum.yaml",
                    throttle_duration_sec=_LOG_PERIOD,
                )

    def _setpoint(self, message: VacuumCommand, driver: RegulatorDriver) -> VacuumSetpoint:
        """All channels, those that the command does not name as they were. Raises
        CommandRejectedError.
        """
        if self._estop:
            raise CommandRejectedError("the arm is in emergency stop and vent_on_estop is set")
        stale = self.get_parameter("stale_time").value
        target = dict(zip(self._names, driver.target.pressure, strict=True))
        target |= vacuum_setpoint(message, self._names, time.time(), stale)
        a, b, c = target.values()
        return VacuumSetpoint((a, b, c))

    def _look_at_arm(self, message: WristState) -> None:
        estop = message.safety_state == WristState.SAFETY_EMERGENCY_STOP
        with self._judging:
            began, self._estop = estop and not self._estop, estop
            if began:
                self._vent()
        if began:
            self.get_logger().error("emergency stop of the arm: the fingers are vented")

    def _on_vent(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self._vent()
        response.message = (
            "vented" if response.success else "the regulator is away; it vents when it is back"
        )
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


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    return common.run(VacuumRegulator, arguments, realtime=common.REALTIME_PRIORITY - 1)


if __name__ == "__main__":
    sys.exit(main())
