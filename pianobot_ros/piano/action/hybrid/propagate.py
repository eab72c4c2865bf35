"""Exact propagation of z' = A z for the small systems of the hybrid action.

A general matrix exponential spends more on dispatch (and on waking threads) than on 8 x 8 numbers,
and event location needs
thousands. Here the Taylor series over one grid step serves both: as propagator, and as polynomials
whose roots are the events.
"""

from __future__ import annotations

import numpy as np

from pianobot_ros.cell.arrays import Array

__all__ = ["BLOCK", "GRID", "Propagator"]


GRID = 1e-4  # s; the fastest motion, the hammer on the string, has a period of 4 ms
BLOCK = 128  # grid steps kept ready
_TERMS = 28
_LARGEST = (
    2.0  # |eigenvalue| * GRID up to which the series has converged to rounding (2^28 / 28! < 1e-21)
)


class Propagator:
    """Propagates states of z' = A z; ``a`` is (n, n) in 1/s, with no eigenvalue beyond 2e4 1/s or
    it halves its grid.
    """

    def __init__(self, a: Array) -> None:
        self.a = a
        fastest = float(np.abs(np.linalg.eigvals(a)).max())
        self.grid = GRID
        while fastest * self.grid > _LARGEST:
            self.grid /= 2
        step = np.stack(self.series(np.eye(len(a))))
        step = np.tensordot(self.grid ** np.arange(_TERMS), step, axes=1)
        self.powers = np.empty((BLOCK + 1, *a.shape))
        self.powers[0] = np.eye(len(a))
        for k in range(BLOCK):
            self.powers[k + 1] = step @ self.powers[k]

    def series(self, z: Array) -> list[Array]:
        """Taylor coefficients c_k of z(t) = sum c_k t^k from ``z`` (n,) or (n, m), good for one
        grid step.
        """
        terms = [z]
        for k in range(1, _TERMS):
            terms.append(self.a @ terms[-1] / k)
        return terms

    def advance(self, z: Array, time: float) -> Array:
        """State (n,) or (n, m) ``time`` [s] after ``z``."""
        steps, rest = divmod(time, self.grid)
        blocks, odd = divmod(int(steps), BLOCK)
        for _ in range(blocks):
            z = self.powers[BLOCK] @ z
        if odd:
            z = self.powers[odd] @ z
        if rest > 0:
            out = np.zeros_like(z)
            for term in reversed(self.series(z)):
                out = out * rest + term
            z = out
        return z

    def along(self, z: Array, times: Array) -> Array:
        """States (N, n) at ascending ``times`` [s] (N,) after ``z`` (n,)."""
        out = np.empty((times.size, z.size))
        out[0] = self.advance(z, float(times[0]))
        gaps = np.diff(times)
        if gaps.size and np.ptp(gaps) < 1e-12:
            forward = self.advance(np.eye(z.size), float(gaps.mean()))
            for k in range(gaps.size):
                out[k + 1] = forward @ out[k]
        else:
            for k, gap in enumerate(gaps):
                out[k + 1] = self.advance(out[k], float(gap))
        return out
