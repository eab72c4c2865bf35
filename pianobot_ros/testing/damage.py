"""Damage to recordings, as busy machines, loose plugs and killed nodes do it.

Each function of :data:`DAMAGES` takes a recording and a random generator and returns a hurt copy;
:func:`whole_strikes` counts the strikes that it left as they were.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.cell.recordings.recording import Recording, TimeSeries

__all__ = ["DAMAGES", "Damage", "whole_strikes"]

Damage = Callable[[Recording, np.random.Generator], Recording]

BEFORE, AFTER = 1.0, 0.3  # s around a strike in which nothing may be missing
SHARE = 0.1  # of the strikes or samples that a light damage hurts
TOPICS = (
    "command/wrist",
    "command/vacuum",
    "real/wrist",
    "real/vacuum",
    "real/fsr",
    "real/key_angle",
)


def whole_strikes(before: Recording, after: Recording) -> float:
    """Share of the strikes of ``before`` that are announced, sampled and heard alike in
    ``after``.
    """
    if not before.strikes:
        return 0.0
    marks = [m for m in before.strikes if m in after.strikes]
    return sum(_alike(before, after, m.start - BEFORE, m.end + AFTER) for m in marks) / len(
        before.strikes
    )


def _alike(before: Recording, after: Recording, start: float, end: float) -> bool:
    for name, signal in before.signals.items():
        other = after.signals.get(name)
        if other is None or np.any(np.diff(other.time) < 0):
            return False
        a, b = signal.between(start, end), other.between(start, end)
        if a.value.shape != b.value.shape or not np.array_equal(a.time, b.time):
            return False
        if not np.array_equal(a.value, b.value):
            return False

    def heard(recording: Recording) -> list[Any]:
        return [n for n in recording.notes.get("real", []) if start <= n.time <= end]

    return heard(before) == heard(after)


def _signals(
    recording: Recording, change: Callable[[TimeSeries], TimeSeries], prefix: str = ""
) -> Recording:
    """``recording`` with ``change`` done to the signals whose names begin with ``prefix``."""
    return replace(
        recording,
        signals={k: change(s) if k.startswith(prefix) else s for k, s in recording.signals.items()},
    )


def _keep(signal: TimeSeries, good: NDArray[Any]) -> TimeSeries:
    return TimeSeries(signal.time[good], signal.value[good], signal.unit)


def _topic(recording: Recording, random: np.random.Generator) -> str:
    there = [t for t in TOPICS if any(k.startswith(t) for k in recording.signals)]
    return str(random.choice(there)) if there else "real"


def _span(recording: Recording) -> tuple[float, float]:
    times = [s.time for s in recording.signals.values() if s.time.size]
    return min(t[0] for t in times), max(t[-1] for t in times)


def _some(count: int, random: np.random.Generator, share: float) -> NDArray[np.bool_]:
    """About ``share`` of ``count`` picked (count,), at least one."""
    picked = random.random(count) < share
    if count and not picked.any():
        picked[random.integers(count)] = True
    return np.asarray(picked)


def _window(recording: Recording, random: np.random.Generator) -> tuple[float, float]:
    start, end = _span(recording)
    length = SHARE * (end - start)
    first = random.uniform(start, end - length)
    return float(first), float(first + length)


def window_lost(recording: Recording, random: np.random.Generator) -> Recording:
    """Nothing was recorded for a tenth of the session."""
    low, high = _window(recording, random)
    hurt = _signals(recording, lambda s: _keep(s, (s.time < low) | (s.time > high)))
    notes = {c: [n for n in v if not low <= n.time <= high] for c, v in hurt.notes.items()}
    strikes = [m for m in hurt.strikes if not low <= m.start <= high]
    return replace(hurt, notes=notes, strikes=strikes)


def stream_paused(recording: Recording, random: np.random.Generator) -> Recording:
    """One device was silent for a tenth of the session."""
    low, high = _window(recording, random)
    return _signals(
        recording,
        lambda s: _keep(s, (s.time < low) | (s.time > high)),
        _topic(recording, random),
    )


def topic_lost(recording: Recording, random: np.random.Generator) -> Recording:
    """One topic was not recorded."""
    lost = _topic(recording, random)
    return replace(
        recording, signals={k: s for k, s in recording.signals.items() if not k.startswith(lost)}
    )


def topic_empty(recording: Recording, random: np.random.Generator) -> Recording:
    """A topic was recorded without a message."""
    return _signals(
        recording, lambda s: _keep(s, np.zeros(s.time.size, bool)), _topic(recording, random)
    )


def topic_of_one(recording: Recording, random: np.random.Generator) -> Recording:
    """Of one topic, a single message was recorded."""
    return _signals(
        recording, lambda s: _keep(s, np.arange(s.time.size) == 0), _topic(recording, random)
    )


def marks_lost(recording: Recording, random: np.random.Generator) -> Recording:
    """No strike was announced."""
    return replace(recording, strikes=[])


def marks_reversed(recording: Recording, random: np.random.Generator) -> Recording:
    """Some strikes end before they begin, some lie outside of the session, some have no number."""
    bad: list[dict[str, Any]] = [
        {"end": -1.0},
        {"start": 1e9, "end": 1e9 + 1},
        {"speed": float("nan"), "pressure": float("inf")},
        {"finger": "toe"},
    ]
    pick = _some(len(recording.strikes), random, SHARE)
    return replace(
        recording,
        strikes=[
            replace(m, **bad[int(random.integers(len(bad)))]) if hit else m
            for m, hit in zip(recording.strikes, pick, strict=True)
        ],
    )


def samples_lost(recording: Recording, random: np.random.Generator) -> Recording:
    """Single samples of every topic are missing."""
    return _signals(recording, lambda s: _keep(s, ~_some(s.time.size, random, 0.02)))


def samples_twice(recording: Recording, random: np.random.Generator) -> Recording:
    """Single samples came twice, with the same stamp."""

    def change(s: TimeSeries) -> TimeSeries:
        return _keep(s, np.repeat(np.arange(s.time.size), 1 + _some(s.time.size, random, 0.02)))

    return _signals(recording, change)


def samples_swapped(recording: Recording, random: np.random.Generator) -> Recording:
    """Neighbouring samples of one topic came in the other order."""

    def change(s: TimeSeries) -> TimeSeries:
        order = np.arange(s.time.size)
        for i in np.flatnonzero(_some(max(s.time.size - 1, 0), random, 0.01)):
            order[[i, i + 1]] = order[[i + 1, i]]
        return _keep(s, order)

    return _signals(recording, change, _topic(recording, random))


def not_a_number(recording: Recording, random: np.random.Generator) -> Recording:
    """Single samples of one topic are NaN."""
    return _spoilt(recording, random, float("nan"))


def infinite(recording: Recording, random: np.random.Generator) -> Recording:
    """Single samples of one topic are infinite."""
    return _spoilt(recording, random, float("inf"))


def _spoilt(recording: Recording, random: np.random.Generator, value: float) -> Recording:
    def change(s: TimeSeries) -> TimeSeries:
        x = np.array(s.value, dtype=float)
        x[_some(s.time.size, random, 0.01)] = value
        return TimeSeries(s.time, x, s.unit)

    return _signals(recording, change, _topic(recording, random))


def window_not_a_number(recording: Recording, random: np.random.Generator) -> Recording:
    """One topic is NaN for a tenth of the session."""
    low, high = _window(recording, random)

    def change(s: TimeSeries) -> TimeSeries:
        x = np.array(s.value, dtype=float)
        x[(s.time >= low) & (s.time <= high)] = np.nan
        return TimeSeries(s.time, x, s.unit)

    return _signals(recording, change, _topic(recording, random))


def all_not_a_number(recording: Recording, random: np.random.Generator) -> Recording:
    """One topic is NaN throughout."""
    return _signals(
        recording,
        lambda s: TimeSeries(s.time, np.full_like(s.value, np.nan, dtype=float), s.unit),
        _topic(recording, random),
    )


def sensor_stuck(recording: Recording, random: np.random.Generator) -> Recording:
    """One device repeats its value from some moment of the last tenth on."""
    start, end = _span(recording)
    at = start + (1.0 - SHARE) * (end - start)

    def change(s: TimeSeries) -> TimeSeries:
        i = int(np.searchsorted(s.time, at))
        if not 0 < i < s.time.size:
            return s
        x = np.array(s.value, dtype=float)
        x[i:] = x[i - 1]
        return TimeSeries(s.time, x, s.unit)

    return _signals(recording, change, _topic(recording, random))


def sensor_constant(recording: Recording, random: np.random.Generator) -> Recording:
    """One device says one value throughout."""

    def change(s: TimeSeries) -> TimeSeries:
        return TimeSeries(s.time, np.zeros_like(s.value, dtype=float), s.unit)

    return _signals(recording, change, _topic(recording, random))


def clock_stepped(recording: Recording, random: np.random.Generator) -> Recording:
    """The clock of one device jumps by half a second in the last tenth."""
    start, end = _span(recording)
    at = start + (1.0 - SHARE) * (end - start)

    def change(s: TimeSeries) -> TimeSeries:
        return TimeSeries(np.where(s.time > at, s.time + 0.5, s.time), s.value, s.unit)

    return _signals(recording, change, _topic(recording, random))


def clock_stepped_back(recording: Recording, random: np.random.Generator) -> Recording:
    """The clock of one device jumps back by a second in the last tenth."""
    start, end = _span(recording)
    at = start + (1.0 - SHARE) * (end - start)

    def change(s: TimeSeries) -> TimeSeries:
        return TimeSeries(np.where(s.time > at, s.time - 1.0, s.time), s.value, s.unit)

    return _signals(recording, change, _topic(recording, random))


def truncated(recording: Recording, random: np.random.Generator) -> Recording:
    """The recorder was killed."""
    start, end = _span(recording)
    at = start + random.uniform(0.05, 0.95) * (end - start)
    hurt = _signals(recording, lambda s: _keep(s, s.time < at))
    notes = {c: [n for n in v if n.time < at] for c, v in hurt.notes.items()}
    return replace(hurt, notes=notes, strikes=[m for m in hurt.strikes if m.start < at])


def begun_late(recording: Recording, random: np.random.Generator) -> Recording:
    """The recorder was started in the last tenth before the end of the first strikes."""
    start, end = _span(recording)
    at = start + SHARE * (end - start)
    hurt = _signals(recording, lambda s: _keep(s, s.time > at))
    notes = {c: [n for n in v if n.time > at] for c, v in hurt.notes.items()}
    return replace(hurt, notes=notes, strikes=[m for m in hurt.strikes if m.start > at])


def one_strike(recording: Recording, random: np.random.Generator) -> Recording:
    """Only one strike was announced."""
    return replace(recording, strikes=recording.strikes[:1])


def one_condition(recording: Recording, random: np.random.Generator) -> Recording:
    """Only the repeats of one condition were announced."""
    first = {m.condition for m in recording.strikes[:1]}
    return replace(recording, strikes=[m for m in recording.strikes if m.condition in first])


def silent_strikes(recording: Recording, random: np.random.Generator) -> Recording:
    """Some strikes were not heard."""
    pick = _some(len(recording.strikes), random, SHARE)
    quiet = [m for m, hit in zip(recording.strikes, pick, strict=True) if hit]
    notes = {
        c: [n for n in v if not any(m.start <= n.time <= m.end + AFTER for m in quiet)]
        for c, v in recording.notes.items()
    }
    return replace(recording, notes=notes)


def all_silent(recording: Recording, random: np.random.Generator) -> Recording:
    """The piano was not recorded."""
    return replace(recording, notes={})


def notes_held(recording: Recording, random: np.random.Generator) -> Recording:
    """No note was let go."""
    return replace(recording, notes={c: [n for n in v if n.on] for c, v in recording.notes.items()})


def notes_twice(recording: Recording, random: np.random.Generator) -> Recording:
    """Some notes came twice."""
    return replace(
        recording,
        notes={
            c: [
                n
                for n, k in zip(v, _some(len(v), random, SHARE), strict=True)
                for _ in range(1 + k)
            ]
            for c, v in recording.notes.items()
        },
    )


DAMAGES: Mapping[str, Damage] = {
    f.__name__: f
    for f in (
        window_lost,
        stream_paused,
        topic_lost,
        topic_empty,
        topic_of_one,
        marks_lost,
        marks_reversed,
        samples_lost,
        samples_twice,
        samples_swapped,
        not_a_number,
        infinite,
        window_not_a_number,
        all_not_a_number,
        sensor_stuck,
        sensor_constant,
        clock_stepped,
        clock_stepped_back,
        truncated,
        begun_late,
        one_strike,
        one_condition,
        silent_strikes,
        all_silent,
        notes_held,
        notes_twice,
    )
}
"""All kinds of damage by name."""
