"""What of a recording can be used for a diagnosis: stamps that rise, samples that are numbers,
streams that do not pause within a strike, strikes that the arm played.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable
from dataclasses import astuple, replace

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.recordings.recording import Recording, Strike, TimeSeries

__all__ = ["Losses", "played", "rising", "sound", "told_whole", "whole"]


PAUSE = 0.05
"""s between samples of a fast signal, from which it says nothing about a press in between."""
AWAY = 2.0
"""Lengths of the session from which a stamp is not of it: a clock was set."""
PLAYED = 0.5
"""Share of the commanded travel below which the arm did not play the strike: no lag, compliance or
delay takes half of it, a stopped arm takes all."""
JUMP = 2e-4
"""m of commanded height across a pause, from which commands are missing."""
TRAVEL = 1e-3
"""m of commanded travel below which there is nothing to play."""


class Losses:
    """What was left out of which strikes, counted and said once a reason."""

    def __init__(self) -> None:
        self._of: dict[str, list[int]] = {}

    def add(self, strike: int, reason: str) -> None:
        """Note that of ``strike`` something was left out for ``reason``."""
        self._of.setdefault(reason, []).append(strike)

    def said(self, strikes: int) -> list[str]:
        """One line a reason."""
        return [
            f"{reason} in {len(n)} of {strikes} strikes ({_numbers(n)}): left out there"
            for reason, n in self._of.items()
        ]


def sound(recording: Recording) -> Recording:
    """The recording with rising finite stamps, without samples of one channel that are no numbers
    and without strikes whose numbers are none; what was left out is in its warnings.
    """
    signals, warnings = {}, []
    limits = _session(recording.signals.values())
    for name, signal in recording.signals.items():
        signals[name] = kept = _sound(signal, *limits)
        lost = len(signal.time) - len(kept.time)
        # A channel of nothing but NaN is one that its cell does not measure.
        if lost and not np.all(np.isnan(signal.value)):
            warnings.append(
                f"{name}: {lost} of {len(signal.time)} samples left out, whose stamps step back or"
                " whose values are no numbers"
            )
    strikes = [s for s in recording.strikes if _finite(s)]
    if len(strikes) < len(recording.strikes):
        warnings.append(
            f"{len(recording.strikes) - len(strikes)} strikes left out, whose announcement holds"
            " numbers that are none"
        )
    notes = {
        cell: sorted((e for e in events if np.isfinite(e.time)), key=lambda e: e.time)
        for cell, events in recording.notes.items()
    }
    return replace(
        recording,
        signals={n: s for n, s in signals.items() if len(s.time)},
        notes=notes,
        strikes=sorted(strikes, key=lambda s: s.start),
        warnings=(*recording.warnings, *warnings),
    )


def rising(time: Array) -> NDArray[np.intp]:
    """Indices of the longest part of the stamps (n,) s that rises: where a clock was set back, the
    longer side stays.
    """
    good = np.flatnonzero(np.isfinite(time))
    t = time[good]
    if np.all(np.diff(t) > 0):
        return good
    tails: list[float] = []
    last: list[int] = []
    before = np.full(t.size, -1)
    for i, x in enumerate(t.tolist()):
        at = bisect_left(tails, x)
        before[i] = last[at - 1] if at else -1
        if at == len(tails):
            tails.append(x)
            last.append(i)
        else:
            tails[at], last[at] = x, i
    chain = [last[-1]] if last else []
    while chain and before[chain[-1]] >= 0:
        chain.append(int(before[chain[-1]]))
    return good[np.array(chain[::-1], np.intp)]


def whole(
    signal: TimeSeries | None, start: float, end: float, pause: float = PAUSE, fewest: int = 20
) -> bool:
    """Whether a signal has ``fewest`` samples in [start, end] s and no pause longer than ``pause``
    s in it; it may begin ``pause`` later and end two ``pause`` earlier.
    """
    if signal is None:
        return False
    t = signal.between(start - pause, end + pause).time
    return bool(
        len(t) >= fewest
        and t[0] <= start + pause
        and t[-1] >= end - 2 * pause
        and np.max(np.diff(t[(t >= start) & (t <= end)]), initial=0.0) <= pause
    )


def told_whole(command: TimeSeries | None, start: float, end: float) -> bool:
    """Whether no command is missing in [start, end] s: across a pause it did not move."""
    if command is None:
        return False
    part = command.between(start, end)
    jumps = np.abs(np.diff(part.value[:, 2])) > JUMP
    return not np.any(jumps & (np.diff(part.time) > PAUSE))


def played(
    command: TimeSeries | None, measured: TimeSeries | None, start: float, end: float
) -> bool:
    """Whether the arm moved as far in [start, end] s as it was told to; True where it is not
    known.
    """
    if command is None or measured is None:
        return True
    commanded, done = (s.between(start, end).value for s in (command, measured))
    if len(commanded) < 4 or len(done) < 4:
        return True
    travel = float(np.ptp(commanded[:, 2]))
    return travel < TRAVEL or float(np.ptp(done[:, 2])) >= PLAYED * travel


def _session(signals: Iterable[TimeSeries]) -> tuple[float, float]:
    """First and last stamp, s, that can belong to the session that most signals are of."""
    stamps = [s.time[np.isfinite(s.time)] for s in signals]
    ends = [np.quantile(t, [0.02, 0.98]) for t in stamps if t.size > 1]
    if not ends:
        return -np.inf, np.inf
    low, high = (float(x) for x in np.median(ends, axis=0))
    margin = AWAY * (high - low) + 60.0
    return low - margin, high + margin


def _sound(signal: TimeSeries, first: float, last: float) -> TimeSeries:
    with np.errstate(invalid="ignore"):
        near = (signal.time >= first) & (signal.time <= last)
    keep = rising(np.where(near, signal.time, np.nan))
    value = signal.value[keep]
    table = np.isfinite(value).reshape(len(value), int(np.prod(value.shape[1:])))
    # one regulator of three may be dead
    rows = table.any(axis=1) if signal.unit == "Pa" else table.all(axis=1)
    if keep.size == len(signal.time) and rows.all():
        return signal
    return TimeSeries(signal.time[keep][rows], value[rows], signal.unit)


def _finite(mark: Strike) -> bool:
    numbers = [x for x in astuple(mark) if isinstance(x, (int, float))]
    return bool(np.all(np.isfinite(numbers[:-1])))  # the last, the note's length, may be unknown


def _numbers(strikes: Iterable[int], most: int = 6) -> str:
    every = list(dict.fromkeys(strikes))
    return ", ".join(map(str, every[:most])) + (", …" if len(every) > most else "")
