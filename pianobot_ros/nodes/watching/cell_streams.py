"""The streams of both cells as raw bytes, kept for as long as a strike's window may last."""

from __future__ import annotations

from collections import deque
from itertools import takewhile

from pianobot_msgs.msg import KeyAngle, KeyForce, VacuumState, WristState
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.messages.columns import Place, columns
from pianobot_ros.cell.messages.stamps import first_stamp
from pianobot_ros.nodes.session.clock_sights import ClockSights
from pianobot_ros.nodes.topics.polled import PolledSubscription, stream_qos
from pianobot_ros.piano.gap.evidence.session_clocks import CLOCKS

__all__ = ["CELLS", "CellStreams"]

CELLS = ("real", "sim")
STREAMS = {
    "wrist/state": WristState,
    "vacuum/state": VacuumState,
    "fsr": KeyForce,
    "key_angle": KeyAngle,
}
KEPT = 15.0  # s of streams kept; the longest window that can be compared
PATIENCE = 0.5  # s after the window's end after which no stream is waited for
ALIVE = 0.2  # s; a stream that was silent for longer is not waited for


class CellStreams:
    """Polls the streams of both cells. ``clocks`` is told of what the devices' stamps say."""

    def __init__(self, node: Node, clocks: ClockSights) -> None:
        self._clocks = clocks
        self._streams = {
            f"{cell}/{name}": PolledSubscription(node, kind, f"/{cell}/{name}", stream_qos(500))
            for cell in CELLS
            for name, kind in STREAMS.items()
        }
        self._kept: dict[str, deque[tuple[float, bytes]]] = {
            name: deque() for name in self._streams
        }
        self._fsr_note: int | None = None

    def take(self, now: float) -> None:
        """Take in what has arrived by ``now``, s since the epoch, and drop what is too old."""
        for name, stream in self._streams.items():
            kept, new = self._kept[name], stream.take()
            kept.extend((taken.sent * 1e-9, taken.data) for taken in new)
            if name in CLOCKS:
                self._clocks.note(CLOCKS[name], new)
            while kept and kept[0][0] < now - KEPT:
                kept.popleft()

    def silent(self) -> list[str]:
        """Names of the streams of which nothing is kept."""
        return [name for name, kept in self._kept.items() if not kept]

    def passed(self, end: float, now: float) -> bool:
        """Whether every living stream has passed the time ``end``, or had the time to."""
        newest = [kept[-1] for kept in self._kept.values() if kept and kept[-1][0] > now - ALIVE]
        return now >= end + PATIENCE or not any(
            1e-9 * first_stamp(data) < end for _, data in newest
        )

    def senses(self, note: int) -> bool:
        """Whether the force sensor is on this key."""
        if self._fsr_note is None:
            for cell in CELLS:
                if kept := self._kept[f"{cell}/fsr"]:
                    self._fsr_note = int(deserialize_message(kept[-1][1], KeyForce).note)
                    break
        return self._fsr_note == note

    def window(self, name: str, place: Place, start: float, end: float) -> tuple[Array, Array]:
        """Times (n,) s and values (n,) at ``place`` of the stream ``name`` about a window."""
        kept = takewhile(lambda item: item[0] >= start - 0.1, reversed(self._kept[name]))
        data = [message for sent, message in kept if sent <= end + PATIENCE]
        return columns(data[::-1], place)
