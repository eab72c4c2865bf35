"""A phrase played before and after the twin was corrected: Err of Eq. 5, and the gap in units of
the floor that its own repeats give.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

__all__ = ["LAST_REPORT", "UNHEARD", "Heard", "heard", "is_worse", "share_closed"]

UNHEARD = "unheard"
"""A phrase of other keys, speeds and depths than the diagnosis' own."""
DRAWS = 400
LAST_REPORT = 4.0  # s after a phrase in which its last strikes are compared


@dataclass(frozen=True)
class Heard:
    """``err`` as a fraction, mean over ``strikes`` that sounded on both cells; ``gap``: RMS
    difference over the floor, as RMS over signals; each with its 95 % interval over strikes.
    """

    err: float
    gap: float
    low: float
    high: float
    strikes: int
    err_low: float = math.nan
    err_high: float = math.nan

    def to_json(self) -> dict[str, float | int | None]:
        """Plain numbers, NaN as None."""
        return {n: None if math.isnan(x) else x for n, x in asdict(self).items()}


def heard(reports: Sequence[Any], others: Sequence[Any] = (), seed: int = 0) -> Heard:
    """What GapReports of a phrase say. The floors are those that rest on most strikes of these
    reports and of ``others`` of the same phrase, so that both are measured by the same.
    """
    known_by: dict[tuple[str, str], tuple[int, float]] = {}
    for report in (*reports, *others):
        for s in report.signals:
            place = s.signal, report.keystrokes[0].condition
            if s.floor > 0.0 and s.strikes >= known_by.get(place, (0, 0.0))[0]:
                known_by[place] = s.strikes, s.floor
    floors = {place: floor for place, (_, floor) in known_by.items()}
    errors = [g.err for r in reports for g in r.keystrokes if not math.isnan(g.err)]
    squares = [_squares(r, floors) for r in reports]
    known = [s for s in squares if s]
    gap = _interval(_gap, known, seed)
    err = _interval(_mean, errors, seed)
    return Heard(_mean(errors), _gap(known), *gap, len(errors), *err)


def _interval(
    of: Callable[[Sequence[Any]], float], strikes: Sequence[Any], seed: int
) -> tuple[float, float]:
    """95 % interval of a number ``of`` strikes, by drawing them anew."""
    if not strikes:
        return math.nan, math.nan
    random, count = np.random.default_rng([seed, 0xBEF]), len(strikes)
    drawn = [of([strikes[i] for i in random.integers(0, count, count)]) for _ in range(DRAWS)]
    low, high = np.percentile(drawn, [2.5, 97.5])
    return float(low), float(high)


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else math.nan


def _squares(report: Any, floors: Mapping[tuple[str, str], float]) -> dict[str, float]:
    """Squared gap of each signal of a strike, in floors."""
    condition = report.keystrokes[0].condition if report.keystrokes else ""
    return {
        s.signal: (s.rms / floors[s.signal, condition]) ** 2
        for s in report.signals
        if (s.signal, condition) in floors and not math.isnan(s.rms)
    }


def _gap(strikes: Sequence[Mapping[str, float]]) -> float:
    by_signal: dict[str, list[float]] = defaultdict(list)
    for one in strikes:
        for name, square in one.items():
            by_signal[name].append(square)
    if not by_signal:
        return math.nan
    return float(np.sqrt(np.mean([np.mean(x) for x in by_signal.values()])))


def share_closed(before: Heard, after: Heard, floor: float = 1.0) -> float:
    """Share of the gap above the floor that is gone; NaN where there was none."""
    above = before.gap - floor
    return (before.gap - after.gap) / above if above > 0.0 else math.nan


def is_worse(before: Heard, after: Heard, floor: float = 1.0) -> bool:
    """Whether a correction did harm: Err, or a gap that is above the floor, has grown for certain.
    False where nothing was compared.
    """
    gap = _least_growth((before.gap, before.high), (after.gap, after.low))
    err = _least_growth((before.err, before.err_high), (after.err, after.err_low))
    return (after.gap > floor and gap > 0.0) or err > 0.0


def _least_growth(before: tuple[float, float], after: tuple[float, float]) -> float:
    """Lower end of the interval of a difference, from value and upper end before, value and lower
    end after (Zou and Donner 2008).
    """
    (first, high), (second, low) = before, after
    return second - first - math.hypot(second - low, high - first)
