"""Comparison of a real and a simulated signal over one strike: lag, difference, and how well the
real one repeats.
"""

from __future__ import annotations

from collections import defaultdict, deque
from dataclasses import dataclass

import numpy as np

from pianobot_ros.cell.arrays import Array

__all__ = ["GRID", "Repeats", "SignalComparison", "compare_signals", "lag_between"]


GRID = 0.002  # s between the points at which signals are compared
LONGEST_LAG = 0.15  # s
KEPT = 12  # repeats of a condition that the floor rests on


@dataclass(frozen=True)
class SignalComparison:
    """``lag`` s (positive: the real signal is later, NaN where nothing moves), ``rms`` of the
    difference as it is, and ``rms_aligned`` after shifting by the lag, both in the signal's unit.
    """

    lag: float
    rms: float
    rms_aligned: float


def lag_between(
    real: Array, sim: Array, spacing: float = GRID, longest: float = LONGEST_LAG
) -> float:
    """Time by which ``real`` (n,) is later than ``sim`` (n,), s.

    The shift with the least mean squared difference of the overlapping parts; unlike the product of
    a plain cross-correlation this does not favour shifts that keep large values in view. Finer than
    the spacing, by a parabola through the three lowest points; NaN if either signal does not move,
    or if the best shift lies at the end of the search.
    """
    a, b = real - real.mean(), sim - sim.mean()
    if min(np.ptp(a), np.ptp(b)) < 1e-9 * max(np.abs(real).max(), np.abs(sim).max(), 1e-12):
        return float("nan")
    steps = min(round(longest / spacing), len(a) - 2)
    if steps < 1:
        return float("nan")
    n = len(a)
    # Mean of (a - b)^2 over the overlap of each shift: the squares by running sums, the products
    # all at once.
    aa, bb = (np.concatenate([[0.0], np.cumsum(x * x)]) for x in (a, b))
    s = np.arange(-steps, steps + 1)  # shifts
    squares = (aa[n + np.minimum(s, 0)] - aa[np.maximum(s, 0)]) + (
        bb[n - np.maximum(s, 0)] - bb[np.maximum(-s, 0)]
    )
    products = np.correlate(a, b, "full")[n - 1 - steps : n + steps]
    cost = (squares - 2.0 * products) / (n - np.abs(s))
    k = int(np.argmin(cost))
    if k in (0, len(cost) - 1):
        return float("nan")
    left, centre, right = cost[k - 1 : k + 2]
    curvature = left - 2 * centre + right
    return float(spacing * (s[k] + (0.5 * (left - right) / curvature if curvature > 0 else 0.0)))


def compare_signals(
    real: tuple[Array, Array],
    sim: tuple[Array, Array],
    start: float,
    end: float,
    spacing: float = GRID,
) -> tuple[SignalComparison, Array] | None:
    """Compare two sampled signals, each (time s, value), over a window; also the real one on the
    grid.

    None if either has too few samples to cover nine tenths of the window.
    """
    grid = np.arange(start, end, spacing)
    for time, _ in (real, sim):
        inside = time[(time >= start - 0.05) & (time <= end + 0.05)]
        if (
            len(inside) < 5
            or inside[-1] - inside[0] < 0.9 * (end - start)
            or np.diff(inside).max() > 0.1
        ):
            return None
    a, b = np.interp(grid, *real), np.interp(grid, *sim)
    lag = lag_between(a, b, spacing)
    shifted = np.interp(grid - (0.0 if np.isnan(lag) else lag), *sim)

    def rms(difference: Array) -> float:
        return float(np.sqrt(np.mean(difference**2)))

    return SignalComparison(lag, rms(a - b), rms(a - shifted)), a


class Repeats:
    """How well a signal repeats over strikes of the same condition: the standard deviation over
    repeats at each instant of the window, as RMS over the window."""

    def __init__(self) -> None:
        self._seen: dict[tuple[str, str], deque[Array]] = defaultdict(lambda: deque(maxlen=KEPT))

    def add(self, signal: str, condition: str, values: Array) -> tuple[float, int]:
        """Take in one more strike; returns the floor (NaN until two are known) and the strikes that
        it rests on.
        """
        kept = self._seen[signal, condition]
        kept.append(values)
        if len(kept) < 2:
            return float("nan"), len(kept)
        length = min(len(v) for v in kept)
        table = np.array([v[:length] for v in kept])
        return float(np.sqrt(table.var(axis=0, ddof=1).mean())), len(kept)
