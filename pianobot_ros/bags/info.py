"""What is in a bag: topics, types, counts, rates and gaps."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pianobot_ros.bags.live_writer import being_written
from pianobot_ros.bags.raw_messages import bag_files, other_bags, read_raw
from pianobot_ros.cell.errors import RecordingError

__all__ = ["BagInfo", "TopicInfo", "bag_info"]

STREAM_RATE = 10.0  # Hz; a slower topic is no stream, and silence in it is no gap
GAP_FACTOR, SHORTEST_GAP = 10.0, 0.1  # a gap is so many usual periods, and at least so many seconds


@dataclass(frozen=True)
class TopicInfo:
    """A topic: ``rate`` Hz between its gaps, of what is no stream from the usual period (NaN below
    two messages), ``gaps`` as (start s in the bag, length s).
    """

    name: str
    type: str
    count: int
    rate: float
    gaps: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class BagInfo:
    """A bag: ``start`` s since the epoch, ``duration`` s, ``size`` bytes; ``whole`` False if it
    needs repair, unless it is ``recording`` still; ``damage`` what could not be read, in one line
    each; ``others`` what the directory of a run holds beside this bag.
    """

    path: str
    start: float
    duration: float
    messages: int
    size: int
    whole: bool
    topics: tuple[TopicInfo, ...]
    damage: tuple[str, ...] = ()
    recording: bool = False
    others: str = ""

    def as_dict(self) -> dict[str, Any]:
        """The same as plain data; NaN becomes None."""
        plain = asdict(self)
        for topic in plain["topics"]:
            topic["rate"] = None if np.isnan(topic["rate"]) else topic["rate"]
        return plain


def bag_info(path: str | Path) -> BagInfo:
    """Look through a bag, whole or killed. Raises :class:`RecordingError` if it cannot be read or
    is empty.
    """
    from pianobot_ros.bags.repair import is_whole

    times: dict[str, list[int]] = defaultdict(list)
    types: dict[str, str] = {}
    damage: list[str] = []
    for raw in read_raw(path, damage):
        times[raw.topic].append(raw.log_time)
        types[raw.topic] = raw.type
    if not times:
        raise RecordingError(f"{path} holds no messages")
    first = min(min(t) for t in times.values())
    last = max(max(t) for t in times.values())
    topics = tuple(
        _topic(name, types[name], np.sort(np.array(t, dtype=np.int64)) - first)
        for name, t in sorted(times.items())
    )
    files = bag_files(path)
    others = other_bags(path)
    return BagInfo(
        str(files[0].parent if others else path),
        first * 1e-9,
        (last - first) * 1e-9,
        sum(t.count for t in topics),
        sum(f.stat().st_size for f in files),
        is_whole(files[0].parent),
        topics,
        tuple(damage),
        any(map(being_written, files)),
        others,
    )


def _topic(name: str, kind: str, time_ns: np.ndarray) -> TopicInfo:
    time = time_ns * 1e-9
    steps = np.diff(time)
    if not len(steps):
        return TopicInfo(name, kind, len(time), float("nan"), ())
    # The median over ten messages in a row, since they may be delivered in bursts, says what is a
    # gap. It is no rate: of bursts of seven, most tens span one pause, and the others two. A
    # stream's rate is the number of messages in the time that is no gap.
    span = min(10, len(steps))
    usual = float(np.median(time[span:] - time[:-span])) / span
    rate = 1.0 / usual if usual > 0 else float("nan")
    gaps: list[tuple[float, float]] = []
    if rate >= STREAM_RATE:
        wide = steps > max(GAP_FACTOR * usual, SHORTEST_GAP)
        gaps = [(float(time[i]), float(steps[i])) for i in np.flatnonzero(wide)]
        lasted = float(np.sum(steps[~wide]))
        rate = np.count_nonzero(~wide) / lasted if lasted > 0 else rate
    return TopicInfo(name, kind, len(time), rate, tuple(gaps))
