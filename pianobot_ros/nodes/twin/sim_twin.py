"""``sim_twin``: the simulated cell, paced to real time. It obeys ``/command/…`` and answers under
``/sim/…``.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from pianobot_msgs.msg import StrikeMark, VacuumCommand, WristCommand
from rclpy.serialization import deserialize_message
from std_srvs.srv import SetBool, Trigger

from pianobot_ros.cell.errors import CommandRejectedError, ConfigError
from pianobot_ros.cell.messages.wrist_order import WristOrder
from pianobot_ros.cell.motion.geometry import keyboard
from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.base.common import Health
from pianobot_ros.nodes.session.refused_commands import RefusalPublisher
from pianobot_ros.nodes.topics.polled import PolledSubscription, stream_qos
from pianobot_ros.nodes.twin.adopting import Adopting
from pianobot_ros.nodes.twin.twin_commands import TwinCommands
from pianobot_ros.nodes.twin.twin_loop import TwinLoop
from pianobot_ros.nodes.twin.twin_publishers import Rates, TwinPublishers
from pianobot_ros.piano.gap.adoption.live_laws import parse_effects
from pianobot_ros.piano.gap.adoption.prepare import prepare_laws
from pianobot_ros.piano.gap.effects import LIBRARY
from pianobot_ros.piano.twin.model.cell_model import MECHANISMS, PARAMETERS, TIMESTEP, TwinOptions
from pianobot_ros.piano.twin.stepping.cell_twin import CellTwin

__all__ = ["SimTwin", "main"]

COMMANDS = 1024  # messages: a setpoint each 2 ms for as long as the twin can be behind


class _Settings:
    """The node's parameters, as they are at its start."""

    def __init__(self, node: common.PianoNode) -> None:
        self.step = node.declare("step", TIMESTEP, "s, step of the physics", 1e-5, 5e-4)
        self.mechanism = node.declare(
            "mechanism", MECHANISMS[0], "what moves a key", choices=MECHANISMS
        )
        self.period = node.declare(
            "period", 0.008, "s between two wake-ups of the physics", 5e-4, 0.02
        )
        board = keyboard()
        low, high = board.notes[0], board.notes[-1]
        self.fsr_note = node.declare(
            "fsr_note", 64, "note of the key with the force sensor", low, high
        )
        self.rates = Rates(
            fsr=node.declare("fsr_rate", 500.0, "Hz of fsr", 1.0, 1000.0),
            key_angle=node.declare("key_angle_rate", 250.0, "Hz of key_angle", 1.0, 1000.0),
            wrist=node.declare(
                "wrist_rate", 125.0, "Hz of wrist/state and joint_states", 1.0, 500.0
            ),
            vacuum=node.declare("vacuum_rate", 100.0, "Hz of vacuum/state", 1.0, 500.0),
            status=node.declare("status_rate", 1.0, "Hz of /sim/status", 0.1, 10.0),
        )
        self.clock = node.declare(
            "publish_clock", False, "publish /clock: only where no real cell runs"
        )
        known = ", ".join(LIBRARY)
        self.effects = node.declare(
            "effects",
            [""],
            f"effects switched on, each effect.parameter=value; known effects: {known}",
        )
        self.overlay = node.declare(
            "corrections", "", "overlay that `pianobot adopt` wrote, adopted at the start"
        )
        known = ", ".join(PARAMETERS)
        self.parameters = node.declare(
            "parameters", [""], f"factors, each name=value; known: {known}"
        )


class SimTwin(common.PianoNode):
    """The node: commands and services on the executor's thread, physics and publishing on the
    loop's.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("sim_twin", **options)
        settings = _Settings(self)
        effects = parse_effects(settings.effects)
        self.twin = CellTwin(
            TwinOptions(
                mechanism=settings.mechanism,
                timestep=settings.step,
                parameters=_factors(settings.parameters),
            )
        )
        self.answers = TwinPublishers(
            self,
            self.twin,
            settings.fsr_note,
            settings.rates,
            [text for text in settings.effects if text],
            settings.clock,
        )
        events = common.subscription_events(self, "/command/strike")
        self.create_subscription(
            StrikeMark,
            "/command/strike",
            self.answers.announce,
            common.EVENT_QOS,
            event_callbacks=events,
        )
        self.loop = TwinLoop(
            self.twin, self.answers, settings.period, self._complain, self._take_commands
        )
        self.refusals, self.obedience = RefusalPublisher(self, "sim"), TwinCommands(self.loop)
        # Taken by the loop itself: a message that wakes the executor costs more than the step that
        # obeys it.
        self._commands: list[tuple[PolledSubscription, Callable[[bytes, float], str]]] = [
            (PolledSubscription(self, kind, topic, stream_qos(COMMANDS, reliable=True)), obey)
            for kind, topic, obey in (
                (WristCommand, "/command/wrist", self._obey_wrist),
                (VacuumCommand, "/command/vacuum", self._obey_vacuum),
            )
        ]
        self.adopting = Adopting(self, self.loop, self.answers, effects, settings.overlay)
        self.create_service(Trigger, "~/reset", self._on_reset)
        self.create_service(SetBool, "~/pause", self._on_pause)
        # The first step compiles what no cache holds yet, which takes many seconds: not on the
        # clock, and not while others wait.
        prepare_laws()
        for _ in range(2):
            self.twin.step(self.loop.steps)
            self.twin.reset()
        self.loop.start()

    def diagnose(self) -> Mapping[str, Health]:
        """Whether the twin keeps up, and what it did not obey."""
        health = self.loop.health()
        values = {
            **health.values,
            "rejected": self.refusals.count,
            "clamped": self.obedience.clamped,
            "last_refusal": self.refusals.last,
        }
        return {"physics": replace(health, values=values)}

    def shut_down(self) -> None:
        """End the loop."""
        self.loop.stop()

    def _take_commands(self) -> None:
        for stream, obey in self._commands:
            for taken in stream.take():
                try:
                    limit = obey(taken.data, 1e-9 * taken.sent)
                except CommandRejectedError as error:
                    self.refusals.refuse(stream.topic, common.stamp_of(taken.data), error)
                else:
                    if limit:
                        self.refusals.clamped(stream.topic, common.stamp_of(taken.data), limit)

    def _obey_wrist(self, data: bytes, sent: float) -> str:
        return self.obedience.wrist(WristOrder.read(data), sent)

    def _obey_vacuum(self, data: bytes, sent: float) -> str:
        return self.obedience.vacuum(deserialize_message(data, VacuumCommand), sent)

    def _complain(self, error: Exception) -> None:
        self.get_logger().error(str(error), throttle_duration_sec=1.0)

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.loop.reset()
        response.success, response.message = True, "at rest, time 0"
        return response

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self.loop.pause(request.data)
        response.success, response.message = True, "paused" if request.data else "running"
        return response


def _factors(texts: Sequence[str]) -> dict[str, float]:
    factors: dict[str, float] = {}
    for text in filter(None, texts):
        name, _, value = text.partition("=")
        try:
            factors[name.strip()] = float(value)
        except ValueError:
            raise ConfigError(
                f"parameter '{text}' of the twin: write name=factor, as in joint_damping=1.2"
            ) from None
    return factors


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node."""
    return common.run(SimTwin, arguments, realtime=common.REALTIME_PRIORITY + 1)


if __name__ == "__main__":
    sys.exit(main())
