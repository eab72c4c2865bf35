"""Messages of a bag, by topic: numbers as columns, events one by one.

What is no message of its topic's type, or says what cannot be meant, is left out and counted.
"""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.bags.message_types import typestore
from pianobot_ros.bags.raw_messages import RawMessage
from pianobot_ros.bags.reading.cdr_layout import CdrLayout
from pianobot_ros.bags.reading.decode import BagDecoder
from pianobot_ros.cell.arrays import Array, IntArray
from pianobot_ros.cell.messages.samples import STREAMS
from pianobot_ros.cell.messages.stamps import seconds

__all__ = ["EVENTS", "TYPES", "Collected", "Topic"]

EVENTS = {
    "command/strike": "pianobot_msgs/msg/StrikeMark",
    "real/midi": "pianobot_msgs/msg/MidiEvent",
    "sim/midi": "pianobot_msgs/msg/MidiEvent",
    "real/refusals": "diagnostic_msgs/msg/DiagnosticArray",
    "sim/status": "pianobot_msgs/msg/TwinStatus",
}
TYPES = {**{name: stream.type for name, stream in STREAMS.items()}, **EVENTS}
_NEWER = {"corrections"}  # fields that bags of earlier versions lack
_TOGETHER = 4096  # messages of a topic that are decoded at once
_LAYOUTS = 8  # that are looked for among them; what is left is decoded one by one


class Batch(NamedTuple):
    """Messages of one layout: ``place`` (n,) in their topic, ``stamp`` and ``logged`` (n,) s since
    the epoch, ``fields`` (n, m) each, and the ``note`` (n,) that they name, if they do.
    """

    place: IntArray
    stamp: Array
    logged: Array
    fields: dict[str, Array]
    note: Array | None = None

    def chosen(self, which: Any) -> Batch:
        """Some of the messages."""
        return Batch(
            self.place[which],
            self.stamp[which],
            self.logged[which],
            {name: values[which] for name, values in self.fields.items()},
            None if self.note is None else self.note[which],
        )


@dataclass(frozen=True)
class Topic:
    """The messages of one topic, those of events also by ``place``: ``events[place]``."""

    batches: tuple[Batch, ...]
    events: dict[int, Any]

    def places(self) -> IntArray:
        """Of all messages, in order."""
        return np.sort(np.concatenate([batch.place for batch in self.batches]))

    def column(self, name: str) -> Array:
        """``stamp`` or ``logged`` of all messages, in order of recording."""
        order = np.argsort(np.concatenate([batch.place for batch in self.batches]), kind="stable")
        return np.asarray(np.concatenate([getattr(b, name) for b in self.batches])[order])

    def chosen(self, places: IntArray) -> Topic:
        """Only the messages at these places."""
        batches = (b.chosen(np.isin(b.place, places)) for b in self.batches)
        return Topic(tuple(b for b in batches if len(b.place)), self.events)

    def __len__(self) -> int:
        return sum(len(batch.place) for batch in self.batches)

    def messages(self) -> list[tuple[float, Any]]:
        """Stamp and message of each event, in order."""
        pairs = zip(self.column("stamp"), self.places(), strict=True)
        return [(float(stamp), self.events[int(place)]) for stamp, place in pairs]


class Collected:
    """Takes the messages in, one after the other."""

    def __init__(self) -> None:
        self._decoder = BagDecoder()
        self._waiting: dict[str, list[RawMessage]] = {}
        self._taken: Counter[str] = Counter()
        self._batches: dict[str, list[Batch]] = {}
        self._events: dict[str, dict[int, Any]] = {}
        self._unreadable: Counter[str] = Counter()
        self._implausible: Counter[str] = Counter()
        self._foreign: Counter[tuple[str, str]] = Counter()
        self._lacking: Counter[tuple[str, str]] = Counter()

    def take(self, name: str, raw: RawMessage) -> None:
        """One message of the topic ``name``, a key of :data:`TYPES`."""
        if raw.type != TYPES[name]:
            self._foreign[name, raw.type] += 1
            return
        waiting = self._waiting.setdefault(name, [])
        waiting.append(raw)
        if len(waiting) == _TOGETHER:
            self._decode(name)

    def topics(self) -> dict[str, Topic]:
        """The topics that have messages."""
        for name in self._waiting:
            self._decode(name)
        return {
            name: Topic(tuple(self._batches[name]), self._events.get(name, {}))
            for name in self._waiting
            if self._batches.get(name)
        }

    def warnings(self) -> list[str]:
        """A line for each kind of message that was left out."""
        return [
            *(f"{n} messages of /{t} could not be decoded" for t, n in self._unreadable.items()),
            *(
                f"{n} messages of /{t} hold what cannot be meant: left out"
                for t, n in self._implausible.items()
            ),
            *(
                f"{n} messages of /{t} are of the type {k[:80]}, not {TYPES[t]}: left out"
                for (t, k), n in self._foreign.items()
            ),
            *(
                f"{n} messages of /{t} lack the fields {k[:80]}, as their type stands in the bag:"
                " left out"
                for (t, k), n in self._lacking.items()
            ),
        ]

    def _decode(self, name: str) -> None:
        waiting, self._waiting[name] = self._waiting[name], []
        first = self._taken[name]
        self._taken[name] += len(waiting)
        found = self._samples(name, waiting) if name in STREAMS else self._each(name, waiting)
        for place, stamp, logged, fields, note in found:
            said = np.where(stamp > 0, stamp, logged)
            batch = Batch(first + place, said, logged, fields, note)
            self._batches.setdefault(name, []).append(batch)

    def _each(self, name: str, messages: Sequence[RawMessage]) -> Iterator[Batch]:
        """Events: the messages themselves."""
        events = self._events.setdefault(name, {})
        first = self._taken[name] - len(messages)
        rows = []
        for i, raw in enumerate(messages):
            try:
                message = self._decoder.decode(raw)
                if lacking := self._needed(raw.type) - set(vars(message)):
                    self._lacking[name, ", ".join(sorted(lacking))] += 1
                    continue
                rows.append((i, seconds(message.header.stamp), _logged(raw)))
            except (ValueError, AttributeError, TypeError):
                self._unreadable[name] += 1
                continue
            events[first + i] = message
        if rows:
            place, stamp, logged = map(np.array, zip(*rows, strict=True))
            yield Batch(place, stamp, logged, {})

    @staticmethod
    def _needed(kind: str) -> set[str]:
        """Fields of a type as pianobot knows it, which an earlier version may not lack."""
        return {name for name, _ in typestore().fielddefs[kind][1]} - _NEWER

    def _samples(self, name: str, messages: Sequence[RawMessage]) -> Iterator[Batch]:
        """Samples, all of one layout at once."""
        groups: dict[tuple[str, int], list[int]] = {}
        for i, raw in enumerate(messages):
            groups.setdefault((raw.schema.text, len(raw.data)), []).append(i)
        for members in groups.values():
            data = np.frombuffer(b"".join(messages[i].data for i in members), np.uint8)
            rows = data.reshape(len(members), -1)
            for layout, same in self._layouts([messages[i] for i in members], rows):
                place = np.array(members)[same]
                try:
                    if layout is None:
                        raise ValueError
                    batch = self._batch(name, layout.columns(rows[same]), place, messages)
                except (ValueError, AttributeError, TypeError):
                    self._unreadable[name] += len(same)
                else:
                    if batch is not None:
                        yield batch

    def _layouts(
        self, messages: Sequence[RawMessage], rows: NDArray[np.uint8]
    ) -> Iterator[tuple[CdrLayout | None, IntArray]]:
        """Messages of one length by their layout: the numbers of those that share it."""
        left, looked = np.arange(len(messages)), 0
        while len(left):
            layout, same = None, left[:1]
            with contextlib.suppress(ValueError):
                layout = self._decoder.layout(messages[left[0]])
                if looked < _LAYOUTS:
                    same, looked = left[layout.shared_by(rows[left])], looked + 1
            yield layout, same
            left = left[1:] if len(same) == 1 else np.setdiff1d(left, same)

    def _batch(
        self, name: str, columns: Any, place: IntArray, messages: Sequence[RawMessage]
    ) -> Batch | None:
        """What messages of one layout say; None if none of them can be meant."""
        stamp = columns.header.stamp
        time = stamp.sec.astype(float) + 1e-9 * stamp.nanosec
        try:
            fields, sound = STREAMS[name].table(columns, len(place))
        except (ValueError, AttributeError, TypeError):
            self._implausible[name] += len(place)
            return None
        if wrong := int(np.sum(~sound)):
            self._implausible[name] += wrong
        if wrong == len(place):
            return None
        logged = np.array([_logged(messages[i]) for i in place])
        return Batch(place, time, logged, fields, getattr(columns, "note", None)).chosen(sound)


def _logged(raw: RawMessage) -> float:
    """When it was published, or else recorded, s since the epoch."""
    return (raw.sent or raw.log_time) * 1e-9
