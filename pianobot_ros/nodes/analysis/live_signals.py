"""The streams of the running real cell and the commands, collected as they come and decoded a batch
at a time.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticArray
from pianobot_msgs.msg import MidiEvent, StrikeMark, TwinStatus
from rclpy.node import Node

from pianobot_ros.cell.messages.events import note_event, strike
from pianobot_ros.cell.messages.refusals import refusals
from pianobot_ros.cell.messages.stamps import first_stamp, seconds
from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.topics.decoding import KINDS, Decoder
from pianobot_ros.nodes.topics.polled import PolledSubscription, stream_qos
from pianobot_ros.piano.gap.diagnosis.live import Collector
from pianobot_ros.piano.gap.evidence.session_clocks import CLOCKS

__all__ = ["LiveSignals"]

PERIOD = 0.5  # s between two decodings
DEPTH = 2000  # messages of one topic that may come meanwhile, with a wide margin


class LiveSignals:
    """Feeds a :class:`Collector` from construction until :meth:`close`. ``lock`` guards the
    collector.

    Args:
        node: whose executor turns this.
        collector: where everything goes.
        key: also the key's force and angle.
    """

    def __init__(self, node: Node, collector: Collector, *, key: bool = True) -> None:
        self._node, self.collector, self.lock = node, collector, threading.Lock()
        self._decoder = Decoder(collector)
        names = ["command/wrist", "real/wrist/state", "command/vacuum", "real/vacuum/state"]
        names += ["real/fsr", "real/key_angle"] if key else []
        self._streams = {
            name: PolledSubscription(
                node,
                KINDS[name.removeprefix("real/")],
                f"/{name}",
                stream_qos(DEPTH, reliable=name.startswith("command/")),
            )
            for name in names
        }
        self._subscriptions = [
            node.create_subscription(MidiEvent, "/real/midi", self.midi, common.EVENT_QOS),
            node.create_subscription(StrikeMark, "/command/strike", self.strike, common.EVENT_QOS),
            node.create_subscription(TwinStatus, "/sim/status", self.status, common.SENSOR_QOS),
            node.create_subscription(
                DiagnosticArray, "/real/refusals", self.refuse, common.EVENT_QOS
            ),
        ]
        self._timer = node.create_timer(PERIOD, self.poll)

    @property
    def dropped(self) -> int:
        """Samples that were no pose."""
        return self._decoder.dropped

    def poll(self) -> None:
        """Take in what has arrived."""
        for name, stream in self._streams.items():
            if taken := stream.take():
                self.feed(name, [one.data for one in taken])
                if name in CLOCKS:
                    best = min(taken, key=lambda one: one.sent - first_stamp(one.data))
                    with self.lock:
                        self.collector.sight(CLOCKS[name], first_stamp(best.data), best.sent)

    def feed(self, name: str, messages: Sequence[bytes]) -> None:
        """Serialized messages of one topic, its name without the leading slash."""
        with self.lock:
            self._decoder.feed(name, messages)

    def close(self) -> None:
        """Stop listening."""
        self._node.destroy_timer(self._timer)
        for stream in self._streams.values():
            stream.destroy()
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._streams, self._subscriptions = {}, []

    def midi(self, message: MidiEvent) -> None:
        """A note event of the real cell."""
        event = note_event(message, seconds(message.header.stamp))
        if event is not None:
            with self.lock:
                self.collector.note(event)

    def status(self, message: TwinStatus) -> None:
        """What the twin has adopted."""
        with self.lock:
            self.collector.corrections = message.corrections

    def refuse(self, message: DiagnosticArray) -> None:
        """Commands that the real cell did not obey as given."""
        with self.lock:
            for refusal in refusals(message):
                self.collector.refusal(refusal)

    def strike(self, message: StrikeMark) -> None:
        """An announced strike."""
        found = strike(message, seconds(message.header.stamp))
        if found is not None:
            with self.lock:
                self.collector.strike(found)
