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
from dataclasses import dataclass, fields

import numpy as np
from numba import njit

from pianobot_ros.gap.problem.layout import Index
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
    x: Array, at: Index, decay: Array, gain: Array, scale: Array, level: Array, out: Array
) -> None:  # pragma: no cover
    m = x.shape[1]
    mean = np.zeros(m)
    for i in range(at.size):
        row = at[i]
        for j in range(m):  # columns inside: they lie side by side in memory
            predicted = mean[j] * decay[i]
            innovation = x[row, j] - level[i] * predicted
            out[row, j] = innovation * scale[i]
            mean[j] = predicted + gain[i] * innovation


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _transposed(
    x: Array, at: Index, decay: Array, gain: Array, scale: Array, level: Array, out: Array
) -> None:  # pragma: no cover
    m = x.shape[1]
    mean = np.zeros(m)  # what the samples that follow weigh the mean of this one by
    for i in range(at.size - 1, -1, -1):
        row = at[i]
        for j in range(m):
            innovation = scale[i] * x[row, j] + gain[i] * mean[j]
            out[row, j] = innovation
            mean[j] = (mean[j] - level[i] * innovation) * decay[i]


@dataclass(frozen=True)
class Whitener:
    """The filter of one series or of several one after the other: built once from time stamps (n,)
    and noise, applied to the samples `at` (n,) of any number of columns.
    """

    decay: Array
    gain: Array
    scale: Array
    level: Array
    at: Index

    @classmethod
    def of(
        cls, t: Array, white: Array, sigma_c: Array | float, tau: float, at: Index | None = None
    ) -> Whitener:
        """The filter for one series; ``sigma_c`` may be another at each sample (n,). Without `at`
        all samples are its own.
        """
        level = np.ascontiguousarray(np.broadcast_to(sigma_c, t.shape), dtype=float)
        decay, gain, scale = _gains(t, white, level, float(max(tau, 1e-9)))
        return cls(decay, gain, scale, level, np.arange(t.size) if at is None else at)

    @classmethod
    def joined(cls, parts: Sequence[Whitener]) -> Whitener:
        """One after the other: what came before is forgotten where a series begins (decay 0)."""
        each = ([getattr(w, f.name) for w in parts] for f in fields(cls))
        return cls(*map(np.concatenate, each))

    def apply(self, x: Array) -> Array:
        """Innovations of the columns of `x` (size, m), in units of their own standard deviation; 0
        where a sample is not of this filter.
        """
        out = np.zeros(x.shape)
        _innovations(
            np.ascontiguousarray(x), self.at, self.decay, self.gain, self.scale, self.level, out
        )
        return out

    def transposed(self, x: Array) -> Array:
        """The transposed of :meth:`apply`, of `x` (size, m)."""
        out = np.zeros(x.shape)
        _transposed(
            np.ascontiguousarray(x), self.at, self.decay, self.gain, self.scale, self.level, out
        )
        return out
