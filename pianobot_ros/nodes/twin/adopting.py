"""What ``sim_twin`` has adopted of a diagnosis: at its start, and by its services ``~/adopt`` and
``~/forget``. It outlasts a twin that dies.
"""

from __future__ import annotations

import time

from pianobot_msgs.srv import Adopt
from sensor_msgs.msg import TimeReference
from std_srvs.srv import Trigger

from pianobot_ros.cell.errors import ConfigError, PianobotError
from pianobot_ros.cell.host.marks import LEGACY
from pianobot_ros.cell.messages.stamps import nanoseconds
from pianobot_ros.nodes.base.common import EVENT_QOS, PianoNode
from pianobot_ros.nodes.session.clock_sights import CLOCKS
from pianobot_ros.nodes.twin.twin_loop import TwinLoop
from pianobot_ros.nodes.twin.twin_publishers import TwinPublishers
from pianobot_ros.piano.gap.adoption.adopt import corrections_of
from pianobot_ros.piano.gap.adoption.live_laws import LiveLaws
from pianobot_ros.piano.gap.effects import LIBRARY
from pianobot_ros.piano.gap.effects.base import ClockLaw, acting
from pianobot_ros.piano.gap.simulation.corrections import (
    NOTHING,
    Corrections,
    parse_corrections,
    read_corrections,
)

__all__ = ["Adopting"]

_ADOPTED = "adopted"  # name in the legacy


class Adopting:
    """The services, and the corrections in force. ``effects`` are those of the node's parameter:
    they stay when a correction is forgotten.
    """

    def __init__(
        self,
        node: PianoNode,
        loop: TwinLoop,
        answers: TwinPublishers,
        effects: Corrections,
        overlay: str,
    ) -> None:
        self._node, self._loop, self._answers, self._effects = node, loop, answers, effects
        self.adopted = NOTHING
        first = self._first(overlay)
        node.create_subscription(TimeReference, CLOCKS, self._on_clock, EVENT_QOS)
        loop.twin.correct(self._laws(first))
        self._note(first)
        node.create_service(Adopt, "~/adopt", self._on_adopt)
        node.create_service(Trigger, "~/forget", self._on_forget)

    def _first(self, overlay: str) -> Corrections:
        """What to begin with: what the twin had that died, else the file of the parameter."""
        left = LEGACY.get(_ADOPTED)
        if left is None:
            return read_corrections(overlay) if overlay else NOTHING
        found = parse_corrections(left, "what the twin had adopted") if left else NOTHING
        if found or overlay:
            told = ", ".join(found.names()) or "nothing"
            self._node.get_logger().warning(f"as the twin that died, it has adopted {told}")
        return found

    def _laws(self, corrections: Corrections) -> LiveLaws | None:
        """The laws in force; the devices' clocks follow them."""
        whole = corrections.beside(self._effects.effects)
        laws = LiveLaws(whole) if whole else None
        # what the node's parameter switches on needs no real cell beside it
        clocks = acting((LIBRARY[n] for n in self._effects.effects), ClockLaw)
        since = time.time_ns() if clocks else None
        self._answers.clocks.follow(laws.skews() if laws else {}, since)
        return laws

    def _note(self, corrections: Corrections) -> None:
        self.adopted = corrections
        adopted = corrections.names(), corrections.to_yaml() if corrections else ""
        self._answers.adopted = adopted
        LEGACY.keep(_ADOPTED, adopted[1])

    def adopt(self, text: str) -> str:
        """Adopt the overlay in ``text`` or in the file that it names; says what was adopted.

        Raises :class:`PianobotError`, with nothing changed, for a wrong overlay, and where
        something else is adopted that this overlay does not build on.
        """
        new = corrections_of(text)
        if not new:
            raise ConfigError("the overlay corrects nothing")
        if self.adopted and new.identity == self.adopted.identity:
            raise ConfigError("this overlay is adopted already")
        if self.adopted and new.follows != self.adopted.identity:
            raise ConfigError(
                f"the twin has adopted {', '.join(self.adopted.names())}: call ~/forget first"
            )
        self._loop.correct(self._laws(new))
        self._note(new)
        return "adopted " + ", ".join(new.names())

    def _on_clock(self, message: TimeReference) -> None:
        stamp, sent = nanoseconds(message.time_ref), nanoseconds(message.header.stamp)
        self._answers.clocks.observe(message.source, stamp, sent)

    def _on_adopt(self, request: Adopt.Request, response: Adopt.Response) -> Adopt.Response:
        try:
            response.message, response.success = self.adopt(request.corrections), True
            self._node.get_logger().info(response.message)
        except PianobotError as error:
            response.success, response.message = False, " ".join(str(error).split())
        return response

    def _on_forget(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if not self.adopted:
            response.success, response.message = False, "nothing is adopted"
            return response
        self._loop.correct(self._laws(NOTHING))
        response.success = True
        response.message = "forgot " + ", ".join(self.adopted.names())
        self._note(NOTHING)
        return response
