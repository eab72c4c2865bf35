"""Lifecycle nodes: transitions that fail with one line, and the node that owns one device."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Protocol, TypeVar

from rclpy.callback_groups import CallbackGroup
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import QoSProfile

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.devices.base import DeviceConfig, Health, HealthLevel
from pianobot_ros.devices.serial_line import LinkConfig
from pianobot_ros.nodes.base.diagnostics import Diagnostics
from pianobot_ros.nodes.base.node_parameters import declare
from pianobot_ros.nodes.topics.polled import PolledSubscription, Taken, Watch, stream_qos
from pianobot_ros.nodes.topics.qos import publisher_events, subscription_events

__all__ = ["DeviceNode", "Driver", "GuardedLifecycle"]

ConfigT = TypeVar("ConfigT", bound=DeviceConfig)


class Driver(Protocol):
    """What :meth:`DeviceNode.health_of` needs of a driver."""

    def health(self) -> Health:
        """How the device is doing."""


class GuardedLifecycle(LifecycleNode):
    """A lifecycle node whose transitions call four methods, and which keeps what these make.

    A PianobotError fails the transition with one log line; any other exception goes to the error
    state with its traceback. What :meth:`add_publisher` and :meth:`add_service` made is destroyed
    after :meth:`release`, what :meth:`add_subscription` and :meth:`add_watch` made before
    :meth:`stop`.
    """

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self._last_failure = ""
        self._offered: list[Callable[[], object]] = []  # what destroys a publisher or a service
        self._heard: list[Callable[[], object]] = []  # what ends a subscription

    # What a derived class provides.

    def setup(self) -> None:
        """Open the device and create publishers. Raise a PianobotError if it cannot be."""

    def start(self) -> None:
        """Begin to command and to publish."""

    def stop(self) -> None:
        """Bring the device to rest."""

    def release(self) -> None:
        """Close the device. Called after a failed :meth:`setup` too, so it must cope with half of
        one.
        """

    def managed(self) -> None:
        """Called when somebody takes the lifecycle in hand."""

    # What they make.

    def add_publisher(self, kind: type, topic: str, qos: QoSProfile) -> Any:
        """A publisher that speaks while the node is active, until it is cleaned up."""
        publisher = self.create_lifecycle_publisher(
            kind, topic, qos, event_callbacks=publisher_events(self, topic)
        )
        self._offered.append(partial(self.destroy_lifecycle_publisher, publisher))
        return publisher

    def add_service(
        self,
        kind: type,
        name: str,
        callback: Callable[..., Any],
        group: CallbackGroup | None = None,
    ) -> None:
        """A service that is there until the node is cleaned up."""
        service = self.create_service(kind, name, callback, callback_group=group)
        self._offered.append(partial(self.destroy_service, service))

    def add_subscription(
        self, kind: type, topic: str, callback: Callable[[Any], None], qos: QoSProfile
    ) -> None:
        """Messages of ``topic`` until the node is deactivated."""
        events = subscription_events(self, topic)
        subscription = self.create_subscription(kind, topic, callback, qos, event_callbacks=events)
        self._heard.append(partial(self.destroy_subscription, subscription))

    def add_watch(
        self,
        kind: type,
        topic: str,
        callback: Callable[[Any], None],
        period: float | Callable[[Sequence[Taken]], float],
        *,
        depth: int = 1,
        reliable: bool = False,
        read: Callable[[Taken], Any] | None = None,
    ) -> None:
        """The last ``depth`` messages of a fast ``topic``, looked for every ``period`` s on a
        thread of its own, until the node is deactivated; ``period`` and ``read`` as those of a
        :class:`Watch`.
        """
        stream = PolledSubscription(self, kind, topic, stream_qos(depth, reliable))
        self._heard.append(Watch(stream, callback, period, read).close)

    def _stop(self) -> None:
        try:
            _call_all(self._heard)
        finally:
            self.stop()

    def _release(self) -> None:
        try:
            self.release()
        finally:
            _call_all(self._offered)

    # Lifecycle.

    @property
    def state(self) -> str:
        """Label of the lifecycle state: unconfigured, inactive, active or finalized."""
        return str(self._state_machine.current_state[1])

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle transition; calls :meth:`setup`."""
        result = self._guarded("configure", self.setup)
        if result == TransitionCallbackReturn.SUCCESS:
            return super().on_configure(state)
        self._guarded("clean up", self._release)
        return result

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle transition; enables the lifecycle publishers, then calls :meth:`start`."""
        enabled = super().on_activate(state)
        result = self._guarded("activate", self.start)
        if result != TransitionCallbackReturn.SUCCESS:
            _call_all(self._heard)
            super().on_deactivate(state)
        else:
            self._last_failure = ""
        return result if enabled == TransitionCallbackReturn.SUCCESS else enabled

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle transition; calls :meth:`stop`, then disables the lifecycle publishers."""
        self.managed()
        result = self._guarded("deactivate", self._stop)
        disabled = super().on_deactivate(state)
        return result if disabled == TransitionCallbackReturn.SUCCESS else disabled

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle transition; calls :meth:`release`."""
        self.managed()
        super().on_cleanup(state)
        return self._guarded("clean up", self._release)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle transition from any state; leaves the device at rest and closed."""
        self.managed()
        if state.label == "active":
            self._guarded("deactivate", self._stop)
        if state.label in ("active", "inactive"):
            self._guarded("clean up", self._release)
        return super().on_shutdown(state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle error; closes the device and goes back to unconfigured, from where it can be
        configured again.
        """
        self._guarded("stop after an error", self._stop)
        self._guarded("close after an error", self._release)
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


class DeviceNode(GuardedLifecycle):
    """A lifecycle node that owns one device.

    Derived classes declare their parameters in ``__init__`` and override

    - :meth:`setup` (configure): open the device, create publishers; raise a PianobotError if the
      device is not there,
    - :meth:`start` (activate) and :meth:`stop` (deactivate): begin and end commanding; ``stop``
      leaves the device at rest,
    - :meth:`release` (cleanup): close the device,
    - :meth:`diagnose`: the health of each part.

    With the parameter ``autostart`` (the default) the node configures and activates itself, and
    tries again every ``retry_period`` seconds while the device is missing; without it a lifecycle
    manager does.
    """

    declare = declare
    _driver: Any = None

    def release(self) -> None:
        """Close the device."""
        if self._driver is not None:
            self._driver.close()
            self._driver = None

    def load_config(self, config: type[ConfigT], contents: str) -> ConfigT:
        """The configuration of the device, from the file that the parameter ``config`` names."""
        file = f"file with {contents}"
        return config.load(self.declare("config", config.file(), file, changes="start"))

    def declare_port(self, link: LinkConfig, of: str) -> None:
        """Declare where the device's serial port is, with the file's values."""
        self.declare("port", link.port, f"serial port of the {of}")
        self.declare("baud", link.baud, "Bd of the port", 300, 4_000_000)

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self.declare(
            "autostart",
            True,
            "configure and activate at start-up, and retry while the device is missing",
            changes="any",
        )
        period = self.declare(
            "retry_period",
            1.0,
            "seconds between two attempts to find the device",
            0.1,
            60.0,
            changes="start",
        )
        self.diagnostics = Diagnostics(self, "", self.diagnose)
        self._autostart_timer = self.create_timer(period, self._autostart)
        self._first_timer = self.create_timer(0.0, self._first_start)

    def diagnose(self) -> Mapping[str, Health]:
        """How each part of the node is doing; published at 1 Hz."""
        return {"node": Health(HealthLevel.OK, self.state, age_s=0.0)}

    def health_of(self, part: str, driver: Driver | None, **values: Any) -> dict[str, Health]:
        """The driver's health as that of ``part``, with the lifecycle and ``values`` beside it."""
        if driver is None:
            return {part: Health(HealthLevel.STALE, self._last_failure or self.state)}
        health = driver.health()
        values = {**health.values, **values, "lifecycle": self.state}
        return {part: Health(health.level, health.message, health.age_s, values)}

    def on_event(self, level: HealthLevel, text: str) -> None:
        """Log what a driver reports. A line each: rclpy wants one severity for each place in the
        code.
        """
        if level is HealthLevel.OK:
            self.get_logger().info(text)
        elif level is HealthLevel.WARN:
            self.get_logger().warning(text)
        else:
            self.get_logger().error(text)

    def shut_down(self) -> None:
        """Deactivate, clean up and finalize, from whatever state the node is in."""
        self.managed()
        self._step("active", self.trigger_deactivate)
        self._step("inactive", self.trigger_cleanup)
        self._step("unconfigured", self.trigger_shutdown)

    def _step(self, state: str, trigger: Callable[[], object]) -> None:
        if self.state == state:
            trigger()

    def managed(self) -> None:
        """Once it has run, or once somebody manages the lifecycle by hand, starting is no longer
        this node's decision.
        """
        self._autostart_timer.cancel()

    # Autostart.

    def _first_start(self) -> None:
        self._first_timer.cancel()
        self._autostart()

    def _autostart(self) -> None:
        if not self.get_parameter("autostart").value:
            return
        self._step("unconfigured", self.trigger_configure)
        self._step("inactive", self.trigger_activate)
        if self.state == "active":
            self.managed()
            self.get_logger().info("active")


def _call_all(ends: list[Callable[[], object]]) -> None:
    """Call what ends things, each once."""
    while ends:
        ends.pop()()
