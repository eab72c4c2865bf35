"""From a bag to a :class:`Recording`.

What cannot be used is left out, counted, and said once in ``Recording.warnings``: messages of
another type than their topic has, cut or garbled ones, numbers that cannot be meant, stamps that
stand alone.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from pianobot_ros.bags.raw_messages import other_bags, read_raw
from pianobot_ros.bags.reading.collect import TYPES, Collected, Topic
from pianobot_ros.cell.errors import CancelledError, RecordingError
from pianobot_ros.cell.messages.events import note_event, strike
from pianobot_ros.cell.messages.poses import rotation_vectors
from pianobot_ros.cell.messages.refusals import refusals
from pianobot_ros.cell.messages.samples import STREAMS
from pianobot_ros.cell.recordings.keystroke import NoteEvent
from pianobot_ros.cell.recordings.recording import Recording, TimeSeries

__all__ = ["read_bag"]

_CELL = re.compile(r"^(?:.*/)?(command|real|sim)/(.+)$")
_ASKED = 1000  # messages after which is asked whether to go on
# s; messages of one topic may overtake one another by less than this without being called a jump
_SMALL_STEP_BACK = 1e-3
_ALONE = 0.5  # s by which a stamp that is wrong differs from those of the messages around it
_SAME = 1e-6  # s within which a stamp is the log's own time
_NEIGHBOURS = 2  # on either side
_LONGEST = 6 * 3600.0  # s; what is stamped further from the middle of a recording is not part of it


def read_bag(path: str | Path, cancelled: Callable[[], bool] | None = None) -> Recording:
    """Read a bag, whole, killed or damaged, into a :class:`Recording` on the time axis of the
    message stamps.

    Topics are recognised below any namespace. A topic whose clock jumps back keeps the samples
    before the jump and those after it has caught up, and ``Recording.warnings`` names it.
    ``cancelled`` is asked every few milliseconds. Raises :class:`RecordingError` for a path without
    a bag, and for one in which nothing that pianobot knows was recorded; :class:`CancelledError`.
    """
    warnings = [others] if (others := other_bags(path)) else []
    topics = _collected(path, warnings, cancelled or (lambda: False))
    sights = {n: _sights(topic) for n, topic in topics.items() if n.startswith("real/")}
    topics = {name: _in_place(name, topic, warnings) for name, topic in topics.items()}
    topics = _near(topics, warnings)
    events = {name: topic.messages() for name, topic in topics.items() if name not in STREAMS}
    topics.pop("sim/status", None)
    corrections = _corrections(events.get("sim/status", []), warnings)
    if not topics:
        why = f" ({'; '.join(warnings)})" if warnings else ""
        raise RecordingError(
            f"{path} holds no topic of a cell (/command/…, /real/… or /sim/…){why}: was the right"
            " bag given?"
        )
    epoch = min(float(topic.column("stamp")[0]) for topic in topics.values())
    signals: dict[str, TimeSeries] = {}
    for name, topic in topics.items():
        if name in STREAMS:
            signals |= _signals(name, topic, epoch, warnings)
    strikes = [strike(m, time - epoch, epoch) for time, m in events.get("command/strike", [])]
    if wrong := strikes.count(None):
        warnings.append(f"{wrong} messages of /command/strike announce no strike: left out")
    return Recording(
        signals=signals,
        notes={
            cell: _notes(events[f"{cell}/midi"], epoch)
            for cell in ("real", "sim")
            if f"{cell}/midi" in events
        },
        strikes=sorted((s for s in strikes if s is not None), key=lambda s: s.start),
        fsr_note=_fsr_note(topics),
        epoch=epoch,
        source=str(path),
        refusals=tuple(
            (refusal.time - epoch, refusal.time - epoch + refusal.lasting, refusal.topic)
            for _, message in events.get("real/refusals", [])
            for refusal in refusals(message)
        ),
        warnings=tuple(warnings),
        corrections=corrections,
        sights={name: seen for name, seen in sights.items() if seen},
    )


def _collected(
    path: str | Path, warnings: list[str], cancelled: Callable[[], bool]
) -> dict[str, Topic]:
    """The topics of a cell, decoded."""
    collected = Collected()
    names: dict[str, str | None] = {}
    for count, raw in enumerate(read_raw(path, warnings)):
        if count % _ASKED == 0 and cancelled():
            raise CancelledError(f"cancelled while {path} was read")
        if raw.topic not in names:
            match = _CELL.match(raw.topic)
            name = f"{match[1]}/{match[2]}" if match else ""
            names[raw.topic] = name if name in TYPES else None
        if (known := names[raw.topic]) is not None:
            collected.take(known, raw)
    topics = collected.topics()
    warnings += collected.warnings()
    return topics


def _corrections(rows: list[_Event], warnings: list[str]) -> str:
    """What the twin had adopted, as the overlay's text; the last where it changed. Bags of versions
    that adopted nothing do not say.
    """
    given = [str(getattr(message, "corrections", "")) for _, message in rows]
    if len(set(given)) > 1:
        warnings.append("what the twin had adopted changed amid the recording: the last counts")
    return given[-1] if given else ""


_Event = tuple[float, Any]  # stamp, s since the epoch, and the message


def _sights(topic: Topic) -> list[tuple[int, float]]:
    """Of each second the message with the least delay: when it was sent, ns, and its stamp less
    that, s. None for a bag whose log has no times of its own; a wrong stamp is none.
    """
    sent = topic.column("logged")
    ahead = topic.column("stamp") - sent
    order = np.lexsort((-ahead, np.floor(sent)))
    best = order[np.unique(np.floor(sent)[order], return_index=True)[1]]
    sent, ahead = sent[best], ahead[best]
    if (np.abs(ahead) < _SAME).all():
        return []
    sound = np.abs(ahead - np.median(ahead)) < _ALONE
    return [(round(1e9 * s), float(a)) for s, a in zip(sent[sound], ahead[sound], strict=True)]


def _in_place(name: str, topic: Topic, warnings: list[str]) -> Topic:
    """A topic without the messages whose stamp stands alone, or lies before an earlier one."""
    stamps, place = topic.column("stamp"), topic.places()
    off = stamps - topic.column("logged")
    width = 2 * _NEIGHBOURS + 1
    kept = np.ones(len(stamps), dtype=bool)
    if len(off) >= width:
        padded = np.pad(off, _NEIGHBOURS, mode="edge")
        usual = np.median(np.lib.stride_tricks.sliding_window_view(padded, width), axis=1)
        kept = np.abs(off - usual) <= _ALONE
        if wrong := int(np.sum(~kept)):
            warnings.append(f"{wrong} samples of /{name} have a wrong stamp: left out")
    stamps, place = stamps[kept], place[kept]
    late = np.maximum.accumulate(stamps) - stamps
    if late.size and late.max() > _SMALL_STEP_BACK:
        warnings.append(
            f"the clock of /{name} jumps back by {late.max():.3f} s: {np.sum(late > 0)} samples"
            " left out"
        )
    return topic.chosen(place[late == 0.0])


def _near(topics: dict[str, Topic], warnings: list[str]) -> dict[str, Topic]:
    """Without what is stamped hours away from the rest: another clock, or a damaged stamp."""
    stamps = {name: topic.column("stamp") for name, topic in topics.items() if len(topic)}
    if not stamps:
        return {}
    middle = float(np.median(np.concatenate(list(stamps.values()))))
    near = {}
    for name, times in stamps.items():
        kept = np.abs(times - middle) < _LONGEST
        if wrong := int(np.sum(~kept)):
            warnings.append(
                f"{wrong} samples of /{name} are stamped hours away from the rest: left out"
            )
        if kept.any():
            near[name] = topics[name].chosen(topics[name].places()[kept])
    return near


def _signals(name: str, topic: Topic, epoch: float, warnings: list[str]) -> dict[str, TimeSeries]:
    """The signals of one topic. Of samples with one stamp only the first can be placed in time."""
    fields = list(dict.fromkeys(field for batch in topic.batches for field in batch.fields))
    signals = {}
    for field in sorted(fields) if name.endswith("key_angle") else fields:
        batches = [batch for batch in topic.batches if field in batch.fields]
        widths = Counter[int]()
        for batch in batches:
            widths[batch.fields[field].shape[1]] += len(batch.place)
        usual, count = widths.most_common(1)[0]
        if other := widths.total() - count:
            warnings.append(
                f"{other} messages of /{name} have another number of values in '{field}': left out"
            )
        if not usual:
            continue
        batches = [batch for batch in batches if batch.fields[field].shape[1] == usual]
        order = np.argsort(np.concatenate([batch.place for batch in batches]), kind="stable")
        stamp = np.concatenate([batch.stamp for batch in batches])[order] - epoch
        value = np.concatenate([batch.fields[field] for batch in batches])[order]
        new = np.diff(stamp, prepend=-np.inf) > 0
        stamp, value = stamp[new], value[new]
        unit = STREAMS[name].column(field).unit
        if field == "rotation":
            value, unit = rotation_vectors(value), "rad"
        elif usual == 1 and field != "position":
            value = value[:, 0]
        signals[f"{name}.{field}"] = TimeSeries(stamp, value, unit)
    return signals


def _notes(rows: list[_Event], epoch: float) -> list[NoteEvent]:
    found = (note_event(message, time - epoch) for time, message in rows)
    return [event for event in found if event is not None]


def _fsr_note(topics: dict[str, Topic]) -> int | None:
    """The key with the force sensor: as the real cell says, else as the twin does."""
    for name in ("real/fsr", "sim/fsr"):
        if name in topics:
            first = min(topics[name].batches, key=lambda batch: int(batch.place[0]))
            return None if first.note is None else int(first.note[0])
    return None
