"""From converter counts to newtons by a monotone curve, and back."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

__all__ = ["FsrCalibration"]


class FsrCalibration:
    """Monotone cubic (Fritsch and Carlson) through calibration points, tabulated for every count of
    the converter.

    Args:
        counts: points, rising.
        force: forces at these points, N, rising.
        bits: of the converter; ``top`` is its largest count.
    """

    def __init__(self, counts: Sequence[float], force: Sequence[float], bits: int) -> None:
        self.top = (1 << bits) - 1
        inside = np.clip(np.arange(self.top + 1, dtype=float), counts[0], counts[-1])
        curve = np.asarray(
            PchipInterpolator(np.asarray(counts, float), np.asarray(force, float))(inside)
        )
        self.table: NDArray[np.float64] = np.maximum.accumulate(curve)
        self._list = self.table.tolist()
        first = int(np.ceil(counts[0]))
        last = min(int(np.floor(counts[-1])), self.top)
        self._counts = np.arange(first, last + 1, dtype=float)
        self._force = self.table[first : last + 1]

    def force(self, counts: int) -> float:
        """Force, N, at ``counts``, which are clipped to the converter's range."""
        return float(self._list[min(max(counts, 0), self.top)])

    def counts(self, force: float) -> int:
        """Counts that a force gives: the inverse within the calibrated range, whose ends are
        held.
        """
        return int(np.rint(np.interp(force, self._force, self._counts)))

    def saturated(self, counts: int) -> bool:
        """Whether the converter is at the top of its range."""
        return counts >= self.top
