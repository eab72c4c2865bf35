"""Whitening of residuals whose noise is white sensor noise plus two variations that are correlated
in time.

Strike-to-strike variation is an Ornstein-Uhlenbeck process of deviation `sigma_c` and correlation
time `tau`, and so is what the twin is wrong by, with a time of its own; sensor noise, time-stamp
jitter and the like are white. The covariance of their sum is inverted exactly by a Kalman filter of
two states, in linear time and on irregular time stamps: the innovations of a residual are
independent with unit variance if, and only if, the residual is nothing but that noise. A raw sum of
squares over autocorrelated samples would be absurdly sure of itself; one process in place of the
two is, too: what is fast passes for slow, and the small change from sample to sample that is left
to it then decides what fits.
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
    t: Array, white: Array, level: Array, tau: Array
) -> tuple[Array, Array, Array]:  # pragma: no cover
    n = t.size
    decay, gain, scale = np.empty((n, 2)), np.empty((n, 2)), np.empty(n)
    p, q, both = 1.0, 1.0, 0.0  # covariance of the two wanders before this sample is seen
    for i in range(n):
        gap = 0.0 if i == 0 else max(t[i] - t[i - 1], 0.0)
        a = 0.0 if i == 0 else np.exp(-gap / tau[0])
        b = 0.0 if i == 0 else np.exp(-gap / tau[1])
        if i > 0:
            p = a * a * p + (1.0 - a * a)
            q = b * b * q + (1.0 - b * b)
            both = a * b * both
        first = level[i, 0] * p + level[i, 1] * both
        second = level[i, 0] * both + level[i, 1] * q
        total = level[i, 0] * first + level[i, 1] * second + white[i] * white[i]
        decay[i, 0], decay[i, 1] = a, b
        gain[i, 0], gain[i, 1] = first / total, second / total
        scale[i] = 1.0 / np.sqrt(total)
        p -= first * first / total
        q -= second * second / total
        both -= first * second / total
    return decay, gain, scale


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _innovations(
    x: Array, at: Index, decay: Array, gain: Array, scale: Array, level: Array, out: Array
) -> None:  # pragma: no cover
    m = x.shape[1]
    first, second = np.zeros(m), np.zeros(m)
    for i in range(at.size):
        row = at[i]
        for j in range(m):  # columns inside: they lie side by side in memory
            a, b = first[j] * decay[i, 0], second[j] * decay[i, 1]
            innovation = x[row, j] - level[i, 0] * a - level[i, 1] * b
            out[row, j] = innovation * scale[i]
            first[j] = a + gain[i, 0] * innovation
            second[j] = b + gain[i, 1] * innovation


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _transposed(
    x: Array, at: Index, decay: Array, gain: Array, scale: Array, level: Array, out: Array
) -> None:  # pragma: no cover
    m = x.shape[1]
    # what the samples that follow weigh the means of this one by
    first, second = np.zeros(m), np.zeros(m)
    for i in range(at.size - 1, -1, -1):
        row = at[i]
        for j in range(m):
            innovation = scale[i] * x[row, j] + gain[i, 0] * first[j] + gain[i, 1] * second[j]
            out[row, j] = innovation
            first[j] = (first[j] - level[i, 0] * innovation) * decay[i, 0]
            second[j] = (second[j] - level[i, 1] * innovation) * decay[i, 1]


@dataclass(frozen=True)
class Whitener:
    """The filter of one series or of several one after the other: built once from time stamps (n,)
    and noise, applied to the samples `at` (n,) of any number of columns. Of each process are
    `decay`, `gain` and `level` (n, 2).
    """

    decay: Array
    gain: Array
    scale: Array
    level: Array
    at: Index

    @classmethod
    def of(
        cls,
        t: Array,
        white: Array,
        correlated: tuple[Array | float, float],
        wrong: tuple[Array | float, float] = (0.0, 1.0),
        at: Index | None = None,
    ) -> Whitener:
        """The filter for one series, of two processes by their deviations, which may be another at
        each sample (n,), and times (s). Without `at` all samples are its own.
        """
        level = np.empty((t.size, 2))
        level[:, 0], level[:, 1] = correlated[0], wrong[0]
        tau = np.maximum([correlated[1], wrong[1]], 1e-9)
        decay, gain, scale = _gains(t, white, level, tau)
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
