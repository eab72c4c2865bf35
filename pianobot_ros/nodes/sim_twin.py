"""``sim_twin``: the simulated cell, paced to real time. It obeys ``/command/…`` and answers under ``/sim/…``."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pianobot_msgs.msg import StrikeMark, VacuumCommand, WristCommand
from rclpy.serialization import deserialize_message
from scipy.spatial.transform import Rotation
from std_srvs.srv import SetBool, Trigger

from pianobot_ros.cell.errors import ConfigError, PianobotError
from pianobot_ros.cell.geometry import keyboard
from pianobot_ros.nodes import common
from pianobot_ros.nodes.common import Health
from pianobot_ros.nodes.polled import PolledSubscription, stream_qos
from pianobot_ros.nodes.twin_loop import TwinLoop
from pianobot_ros.nodes.twin_publishers import Rates, TwinPublishers
from pianobot_ros.twin.cell import Twin
from pianobot_ros.twin.effects import NATIVE_EFFECTS, apply_effects, parse_effects
from pianobot_ros.twin.model import MECHANISMS, PARAMETERS, TIMESTEP, TwinOptions

__all__ = ["SimTwin", "main"]


class SimTwin(common.PianoNode):
    """The node: commands and services on the executor's thread, physics and publishing on the loop's."""

    def __init__(self, **options: Any) -> None:
        super().__init__("sim_twin", **options)
        declare = common.declare
        step = declare(self, "step", TIMESTEP, "s, step of the physics", low=1e-5, high=5e-4, read_only=True)
        mechanism = declare(self, "mechanism", MECHANISMS[0], "what moves a key", choices=MECHANISMS, read_only=True)
        period = declare(
            self, "period", 0.004, "s between two wake-ups of the physics", low=5e-4, high=0.02, read_only=True
        )
        board = keyboard()
        low, high = board.notes[0], board.notes[-1]
        fsr_note = declare(
            self, "fsr_note", 64, "note of the key with the force sensor", low=low, high=high, read_only=True
        )
        rates = Rates(
            fsr=declare(self, "fsr_rate", 500.0, "Hz of fsr", low=1.0, high=1000.0, read_only=True),
            key_angle=declare(self, "key_angle_rate", 250.0, "Hz of key_angle", low=1.0, high=1000.0, read_only=True),
            wrist=declare(
                self, "wrist_rate", 125.0, "Hz of wrist/state and joint_states", low=1.0, high=500.0, read_only=True
            ),
            vacuum=declare(self, "vacuum_rate", 100.0, "Hz of vacuum/state", low=1.0, high=500.0, read_only=True),
            status=declare(self, "status_rate", 1.0, "Hz of /sim/status", low=0.1, high=10.0, read_only=True),
        )
        clock = declare(self, "publish_clock", False, "publish /clock: only where no real cell runs", read_only=True)
        named = "effects switched on, each effect.parameter=value; known: " + ", ".join(sorted(NATIVE_EFFECTS))
        texts = declare(self, "effects", [""], named, read_only=True)
        wrong = declare(
            self, "parameters", [""], "factors, each name=value; known: " + ", ".join(PARAMETERS), read_only=True
        )
        effects = parse_effects(texts)
        self.twin = Twin(TwinOptions(mechanism=mechanism, timestep=step, parameters=_factors(wrong)))
        apply_effects(self.twin.cell, effects)
        self.answers = TwinPublishers(self, self.twin, fsr_note, rates, [t for t in texts if t], clock)
        events = common.subscription_events(self, "/command/strike")
        self.create_subscription(
            StrikeMark, "/command/strike", self.answers.announce, common.EVENT_QOS, event_callbacks=events
        )
        # Taken by the loop itself: a message that wakes the executor costs more than the step that obeys it.
        self._commands = [
            (PolledSubscription(self, kind, topic, stream_qos(64, reliable=True)), callback)
            for kind, topic, callback in (
                (WristCommand, "/command/wrist", self._on_wrist), (VacuumCommand, "/command/vacuum", self._on_vacuum),
            )
        ]  # fmt: skip
        self.loop = TwinLoop(self.twin, self.answers, period, self._complain, self._take_commands)
        self.create_service(Trigger, "~/reset", self._on_reset)
        self.create_service(SetBool, "~/pause", self._on_pause)
        # The first step compiles what no cache holds yet, which takes many seconds: not on the clock, and not while others wait.
        for _ in range(2):
            self.twin.step(self.loop.steps)
            self.twin.reset()
        self.loop.start()

    def diagnose(self) -> Mapping[str, Health]:
        """Whether the twin keeps up."""
        return {"physics": self.loop.health()}

    def shut_down(self) -> None:
        """End the loop."""
        self.loop.stop()

    def _take_commands(self) -> None:
        for stream, callback in self._commands:
            for data, _ in stream.take():
                callback(deserialize_message(data, stream.kind))

    def _complain(self, error: Exception) -> None:
        self.get_logger().error(str(error), throttle_duration_sec=1.0)

    def _on_wrist(self, message: WristCommand) -> None:
        p, q = message.pose.position, message.pose.orientation
        quaternion = np.array([q.x, q.y, q.z, q.w])
        if not abs(float(np.linalg.norm(quaternion)) - 1.0) < 0.01:
            self.get_logger().warning(
                "command rejected: the orientation is no unit quaternion", throttle_duration_sec=1.0
            )
            return
        turn = Rotation.from_quat(quaternion).as_rotvec()
        try:
            self.loop.command_wrist(np.array([p.x, p.y, p.z, *turn]), _nanoseconds(message))
        except PianobotError as error:
            self.get_logger().warning(f"command rejected: {error}", throttle_duration_sec=1.0)

    def _on_vacuum(self, message: VacuumCommand) -> None:
        if len(message.fingers) != len(message.pressure):
            self.get_logger().warning(
                "command rejected: as many pressures as fingers are needed", throttle_duration_sec=1.0
            )
            return
        try:
            pressure = dict(zip(message.fingers, message.pressure, strict=True))
            self.loop.command_vacuum(pressure, _nanoseconds(message))
        except PianobotError as error:
            self.get_logger().warning(f"command rejected: {error}", throttle_duration_sec=1.0)

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.loop.reset()
        response.success, response.message = True, "at rest, time 0"
        return response

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self.loop.pause(request.data)
        response.success, response.message = True, "paused" if request.data else "running"
        return response


def _nanoseconds(message: Any) -> int:
    """The stamp of a command; 0 where none was given."""
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)


def _factors(texts: Sequence[str]) -> dict[str, float]:
    factors: dict[str, float] = {}
    for text in filter(None, texts):
        name, _, value = text.partition("=")
        try:
            factors[name.strip()] = float(value)
        except ValueError:
            raise ConfigError(f"parameter '{text}' of the twin: write name=factor, as in joint_damping=1.2") from None
    return factors


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node."""
    return common.run(SimTwin, arguments, pace=common.PACE + 1)


if __name__ == "__main__":
    sys.exit(main())
