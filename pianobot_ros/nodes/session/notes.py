"""The notes of both cells as they come, asked whether a strike sounded."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence

from pianobot_msgs.msg import MidiEvent
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from pianobot_ros.cell.messages.events import note_event
from pianobot_ros.cell.messages.stamps import seconds
from pianobot_ros.cell.recordings.keystroke import NoteEvent
from pianobot_ros.nodes.topics.polled import PolledSubscription, stream_qos

__all__ = ["EARLY", "EVENTS", "Listener", "began"]

EARLY = 0.05  # s by which a note may come before its strike's window
EVENTS = 200  # notes of one cell that may come between two looks
KEPT = 2000  # notes of one cell that are remembered


def began(events: Iterable[NoteEvent], note: int, start: float, end: float) -> bool:
    """Whether ``note`` began to sound in a strike's window, by the stamps; s since the epoch."""
    return any(e.on and e.note == note and start - EARLY <= e.time <= end for e in events)


class Listener:
    """The notes of each of ``cells``, fetched when :meth:`look` is called."""

    def __init__(self, node: Node, cells: Sequence[str]) -> None:
        self._node = node
        self._streams = {
            cell: PolledSubscription(
                node, MidiEvent, f"/{cell}/midi", stream_qos(EVENTS, reliable=True)
            )
            for cell in cells
        }
        self.events: dict[str, deque[NoteEvent]] = {cell: deque(maxlen=KEPT) for cell in cells}

    def look(self) -> None:
        """Take in what has arrived."""
        for cell, stream in self._streams.items():
            for taken in stream.take():
                message = deserialize_message(taken.data, MidiEvent)
                event = note_event(message, seconds(message.header.stamp))
                if event is not None:
                    self.events[cell].append(event)

    def present(self) -> list[str]:
        """The cells whose notes somebody publishes."""
        return [cell for cell in self.events if self._node.count_publishers(f"/{cell}/midi")]

    def sounded(self, cell: str, note: int, start: float, end: float) -> bool:
        """:func:`began` among the cell's notes so far."""
        return began(self.events[cell], note, start, end)
