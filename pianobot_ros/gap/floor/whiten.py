"""Whitening of residuals whose noise is white sensor noise plus a variation that is correlated in
time.

Strike-to-strike variation is an Ornstein-Uhlenbeck process of deviation `sigma_c` and correlation
time `tau`; sensor noise, time-stamp jitter and the like are white. The covariance of their sum is
inverted exactly by a scalar Kalman filter, in
linear time and on irregular time stamps: the innovations of a residual are independent with unit
variance if, and only if, the residual is nothing but that noise. A raw sum of squares over
autocorrelated samples would be absurdly sure of itself.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit

from pianobot_ros.gap.problem.types import Array


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _gains(
    t: Array, white: Array, level: Array, tau: float
) -> tuple[Array, Array, Array]:  # pragma: no cover
    n = t.size
    decay, gain, scale = np.empty(n), np.empty(n), np.empty(n)
    predicted = 1.0  # variance of the wander before this sample is seen, in units of its level
    for i in range(n):
        a = 0.0 if i == 0 else np.exp(-max(t[i] - t[i - 1], 0.0) / tau)
        if i > 0:
            predicted = a * a * predicted + (1.0 - a * a)
        total = level[i] * level[i] * predicted + white[i] * white[i]
        decay[i] = a
        gain[i] = level[i] * predicted / total
        scale[i] = 1.0 / np.sqrt(total)
        predicted = predicted * (1.0 - level[i] * gain[i])
    return decay, gain, scale


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _innovations(
    x: Array, decay: Array, gain: Array, scale: Array, level: Array, out: Array
) -> None:  # pragma: no cover
    n, m = x.shape
    mean = np.zeros(m)
    for i in range(n):  # columns inside: they lie side by side in memory
        for j in range(m):
            predicted = mean[j] * decay[i]
            innovation = x[i, j] - level[i] * predicted
            out[i, j] = innovation * scale[i]
            mean[j] = predicted + gain[i] * innovation


class Whitener:
    """The filter of one series or of several one after the other: built once from time stamps (n,)
    and noise, applied to any number of columns.
    """

    def __init__(self, decay: Array, gain: Array, scale: Array, level: Array) -> None:
        self._decay, self._gain, self._scale, self._level = decay, gain, scale, level

    @classmethod
    def of(cls, t: Array, white: Array, sigma_c: Array | float, tau: float) -> Whitener:
        """The filter for one series; ``sigma_c`` may be another at each sample (n,)."""
        level = np.ascontiguousarray(np.broadcast_to(sigma_c, t.shape), dtype=float)
        decay, gain, scale = _gains(t, white, level, float(max(tau, 1e-9)))
        return cls(decay, gain, scale, level)

    @classmethod
    def joined(cls, parts: Sequence[Whitener]) -> Whitener:
        """One after the other: what came before is forgotten where a series begins (decay 0)."""
        return cls(
            np.concatenate([w._decay for w in parts]),
            np.concatenate([w._gain for w in parts]),
            np.concatenate([w._scale for w in parts]),
            np.concatenate([w._level for w in parts]),
        )

    def apply(self, x: Array) -> Array:
        """Innovations of the columns of `x` (n, m), in units of their own standard deviation."""
        out = np.empty_like(x)
        x = np.ascontiguousarray(x)
        _innovations(x, self._decay, self._gain, self._scale, self._level, out)
        return out
