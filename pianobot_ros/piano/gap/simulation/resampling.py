"""Compiled passages between grids: most of a prediction's time beside its rollouts was theirs."""

from __future__ import annotations

import numpy as np
from numba import njit

from pianobot_ros.cell.arrays import Array

__all__ = ["moved_along", "sampled"]


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def sampled(times: Array, start: float, step: float, x: Array) -> Array:
    """What ``x`` (n,), on a grid of ``step`` s from ``start`` s, is at ``times`` (m,) s: linear
    between its points, held at its ends.
    """
    out, last = np.empty(times.size), x.size - 1
    for k in range(times.size):
        place = (times[k] - start) / step
        if not place > 0.0:
            out[k] = x[0]
        elif place >= last:
            out[k] = x[last]
        else:
            i = int(place)
            out[k] = x[i] + (place - i) * (x[i + 1] - x[i])
    return out


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def moved_along(own: Array, rolled: Array, other: Array, shift: int, least: float) -> Array:
    """``own`` (n,) plus by how much ``rolled`` (m,) differs from ``other`` (m,), whose point i +
    ``shift`` is its point i; nowhere below ``least``.
    """
    out, last = np.empty(own.size), other.size - 1
    for i in range(own.size):
        j = min(max(i + shift, 0), last)
        out[i] = max(own[i] + (rolled[j] - other[j]), least)
    return out
