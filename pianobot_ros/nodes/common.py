"""What every node shares. Import it as ``from pianobot_ros.nodes import common``.

Hardware nodes derive from :class:`DeviceNode`; the others from :class:`PianoNode`. Both report to ``/diagnostics``
at 1 Hz, refuse unknown parameters, and are run by :func:`run`, which ends them in order on Ctrl-C.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Mapping
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.priority import PACE
from pianobot_ros.devices.base import Health, HealthLevel
from pianobot_ros.nodes.diagnostics import Diagnostics
from pianobot_ros.nodes.parameters import check_overrides, declare
from pianobot_ros.nodes.qos import (
    COMMAND_DEADLINE_S,
    COMMAND_QOS,
    EVENT_QOS,
    LATCHED_QOS,
    SENSOR_QOS,
    command_publisher_qos,
    publisher_events,
    subscription_events,
)
from pianobot_ros.nodes.running import run

__all__ = [
    "COMMAND_DEADLINE_S",
    "COMMAND_QOS",
    "EVENT_QOS",
    "LATCHED_QOS",
    "PACE",
    "SENSOR_QOS",
    "DeviceNode",
    "Diagnostics",
    "Health",
    "HealthLevel",
    "PianoNode",
    "check_overrides",
    "command_publisher_qos",
    "declare",
    "publisher_events",
    "run",
    "seconds",
    "subscription_events",
    "time_msg",
]


def time_msg(nanoseconds: int) -> Time:
    """A stamp from nanoseconds since the epoch, as ``time.time_ns()`` gives them."""
    return Time(sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000)


def seconds(stamp: Time) -> float:
    """Seconds since the epoch of a stamp."""
    return float(stamp.sec) + float(stamp.nanosec) * 1e-9


class PianoNode(Node):
    """A node without hardware. Override :meth:`diagnose` and, if there is something to end, :meth:`shut_down`."""

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self.diagnostics = Diagnostics(self, "", self.diagnose)

    def diagnose(self) -> Mapping[str, Health]:
        """How each part of the node is doing; published at 1 Hz."""
        return {"node": Health(HealthLevel.OK, "running", age_s=0.0)}

    def shut_down(self) -> None:
        """Called before the node is destroyed, while ROS still works."""


class DeviceNode(LifecycleNode):
    """A lifecycle node that owns one device.

    Derived classes declare their parameters in ``__init__`` and override

    - :meth:`setup` (configure): open the device, create publishers; raise a PianobotError if the device is not there,
    - :meth:`start` (activate) and :meth:`stop` (deactivate): begin and end commanding; ``stop`` leaves the device
      at rest,
    - :meth:`release` (cleanup): close the device and destroy what ``setup`` made,
    - :meth:`diagnose`: the health of each part.

    A PianobotError fails the transition with one log line; any other exception goes to the error state with its
    traceback.
    With the parameter ``autostart`` (the default) the node configures and activates itself, and tries again every
    ``retry_period`` seconds while the device is missing; without it a lifecycle manager does.
    """

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self._last_failure = ""
        self._setup_done = False
        declare(self, "autostart", True, "configure and activate at start-up, and retry while the device is missing")
        period = declare(
            self, "retry_period", 1.0, "seconds between two attempts to find the device", low=0.1, high=60.0
        )
        self.diagnostics = Diagnostics(self, "", self.diagnose)
        self._autostart_timer = self.create_timer(period, self._autostart)
        self._first_timer = self.create_timer(0.0, self._first_start)

    # What a derived class provides.

    def setup(self) -> None:
        """Open the device and create publishers. Raise a PianobotError if it cannot be."""

    def start(self) -> None:
        """Begin to command and to publish."""

    def stop(self) -> None:
        """Bring the device to rest."""

    def release(self) -> None:
        """Close the device. Called after a failed :meth:`setup` too, so it must cope with half of one."""

    def diagnose(self) -> Mapping[str, Health]:
        """How each part of the node is doing; published at 1 Hz."""
        return {"node": Health(HealthLevel.OK, self.state, age_s=0.0)}

    # Lifecycle.

    @property
    def state(self) -> str:
        """Label of the lifecycle state: unconfigured, inactive, active or finalized."""
        return str(self._state_machine.current_state[1])

    def shut_down(self) -> None:
        """Deactivate, clean up and finalize, from whatever state the node is in."""
        self._cancel_autostart()
        if self.state == "active":
            self.trigger_deactivate()
        if self.state == "inactive":
            self.trigger_cleanup()
        if self.state == "unconfigured":
            self.trigger_shutdown()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle transition; calls :meth:`setup`."""
        result = self._guarded("configure", self.setup)
        if result == TransitionCallbackReturn.SUCCESS:
            return super().on_configure(state)
        self._guarded("clean up", self.release)
        return result

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle transition; enables the lifecycle publishers, then calls :meth:`start`."""
        enabled = super().on_activate(state)
        result = self._guarded("activate", self.start)
        if result != TransitionCallbackReturn.SUCCESS:
            super().on_deactivate(state)
        else:
            self._last_failure = ""
        return result if enabled == TransitionCallbackReturn.SUCCESS else enabled

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle transition; calls :meth:`stop`, then disables the lifecycle publishers."""
        self._cancel_autostart()
        result = self._guarded("deactivate", self.stop)
        disabled = super().on_deactivate(state)
        return result if disabled == TransitionCallbackReturn.SUCCESS else disabled

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle transition; calls :meth:`release`."""
        self._cancel_autostart()
        super().on_cleanup(state)
        return self._guarded("clean up", self.release)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle transition from any state; leaves the device at rest and closed."""
        self._cancel_autostart()
        if state.label == "active":
            self._guarded("deactivate", self.stop)
        if state.label in ("active", "inactive"):
            self._guarded("clean up", self.release)
        return super().on_shutdown(state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle error; closes the device and goes back to unconfigured, from where it can be configured again."""
        self._guarded("stop after an error", self.stop)
        self._guarded("close after an error", self.release)
        return TransitionCallbackReturn.SUCCESS

    def _guarded(self, what: str, action: Callable[[], None]) -> TransitionCallbackReturn:
        try:
            action()
        except PianobotError as error:
            self._log_failure(f"cannot {what}: {error}")
            return TransitionCallbackReturn.FAILURE
        except Exception:  # rclpy would swallow it without a word
            self.get_logger().error(f"failed to {what}:\n{traceback.format_exc()}")
            return TransitionCallbackReturn.ERROR
        return TransitionCallbackReturn.SUCCESS

    def _log_failure(self, message: str) -> None:
        # While the device is missing the same line would come every second.
        if message != self._last_failure:
            self.get_logger().error(message)
        self._last_failure = message

    # Autostart.

    def _first_start(self) -> None:
        self._first_timer.cancel()
        self._autostart()

    def _autostart(self) -> None:
        if not self.get_parameter("autostart").value:
            return
        if self.state == "unconfigured":
            self.trigger_configure()
        if self.state == "inactive":
            self.trigger_activate()
        if self.state == "active":
            self._cancel_autostart()
            self.get_logger().info("active")

    def _cancel_autostart(self) -> None:
        # Once it has run, or once somebody manages the lifecycle by hand, starting is no longer this node's decision.
        self._autostart_timer.cancel()
