"""Held-out arithmetic in closed form.

Linearised at a fit, the residual of unit u is r_u - J_u d, so its sum of squares is c - 2 g·d +
d·G·d with c = r·r, g = Jᵀr, G = JᵀJ. Once these are stored per unit and observable, refitting
without some units and predicting them takes
only small solves: cross-validation, jackknife and bootstrap cost no simulation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.optimize import lsq_linear

from pianobot_ros.gap.problem.types import Array

Run: TypeAlias = tuple[int, int, int, int]
"""First sample, one past the last, unit, observable."""


@dataclass(frozen=True)
class Quadratic:
    """c (u, o), g (u, o, p), G (u, o, p, p), and n (u, o) samples: `u` units, `o` observables, `p`
    parameters.
    """

    c: Array
    g: Array
    G: Array
    n: Array

    def error(self, d: Array) -> Array:
        """Sum of squares (u, o) after moving the parameters by `d` (p,)."""
        return np.asarray(np.maximum(self.c - 2 * self.g @ d + (self.G @ d) @ d, 0.0))


@dataclass(frozen=True)
class Summed:
    """A Quadratic summed over units: c (o,), g (o, p), G (o, p, p), n (o,)."""

    c: Array
    g: Array
    G: Array
    n: Array

    def mean(self, d: Array) -> Array:
        """Mean squares (o,) after moving the parameters by `d` (p,)."""
        error = self.c - 2 * self.g @ d + (self.G @ d) @ d
        return np.asarray(np.maximum(error, 0.0) / np.maximum(self.n, 1.0))

    def without(self, other: Summed) -> Summed:
        """The rest after taking `other` out."""
        return Summed(self.c - other.c, self.g - other.g, self.G - other.G, self.n - other.n)


def summed(quad: Quadratic, units: NDArray[np.bool_] | None = None) -> Summed:
    """Sum over `units` (u,) bool, or over all."""
    if units is None:
        return Summed(quad.c.sum(0), quad.g.sum(0), quad.G.sum(0), quad.n.sum(0))
    return Summed(
        quad.c[units].sum(0), quad.g[units].sum(0), quad.G[units].sum(0), quad.n[units].sum(0)
    )


def quadratic(
    residual: Array,
    jacobian: Array,
    runs: Sequence[Run],
    shape: tuple[int, int],
    weight: Array | None = None,
) -> Quadratic:
    """Accumulate flat residual (size,) and Jacobian of the *prediction* (size, p) per unit and
    observable.

    `runs` are the stretches of samples of one unit and observable; samples that do not count have
    weight 0.
    """
    units, observables = shape
    p = jacobian.shape[1]
    c, n = np.zeros(shape), np.zeros(shape)
    g, big = np.zeros((units, observables, p)), np.zeros((units, observables, p, p))
    for lo, hi, u, o in runs:
        r, jac = residual[lo:hi], jacobian[lo:hi]
        if weight is not None:
            w = weight[lo:hi]
            n[u, o] += np.count_nonzero(w)
            weighted = jac * w[:, None]
            c[u, o] += r @ (w * r)
        else:
            n[u, o] += hi - lo
            weighted = jac
            c[u, o] += r @ r
        g[u, o] += weighted.T @ r
        big[u, o] += weighted.T @ jac
    return Quadratic(c, g, big, n)


def extend(
    quad: Quadratic,
    residual: Array,
    jacobian: Array,
    column: Array,
    runs: Sequence[Run],
    weight: Array,
) -> Quadratic:
    """`quad` with one more Jacobian column (size,), at the price of one column. The `runs` lie side
    by side.
    """
    units, observables, p = quad.g.shape
    g = np.zeros((units, observables, p + 1))
    big = np.zeros((units, observables, p + 1, p + 1))
    g[..., :p], big[..., :p, :p] = quad.g, quad.G
    table = np.column_stack([residual, jacobian, column]) * (weight * column)[:, None]
    sums = np.add.reduceat(table, [lo for lo, *_ in runs], axis=0)
    at = ([u for *_, u, _ in runs], [o for *_, o in runs])
    total = np.zeros((units, observables, p + 2))
    np.add.at(total, at, sums)
    g[..., p] = total[..., 0]
    big[..., :p, p] = big[..., p, :p] = total[..., 1 : p + 1]
    big[..., p, p] = total[..., p + 1]
    return Quadratic(quad.c, g, big, quad.n)


def solve_map(big: Array, g: Array, prior_offset: Array, low: Array, high: Array) -> Array:
    """Step d minimising d·G·d - 2 g·d + |prior_offset + d|² within the box [low, high], which must
    hold 0: bounded-variable least squares (Stark and Parker 1995) of the Cholesky factor.
    """
    d, free = np.zeros(g.size), high > low
    count = int(free.sum())
    if count:
        root = np.linalg.cholesky(big[np.ix_(free, free)] + np.eye(count))
        wanted = solve_triangular(root, (g - prior_offset)[free], lower=True)
        box = (low[free], high[free])
        d[free] = lsq_linear(root.T, wanted, box, method="bvls", max_iter=3 * count + 5).x
    return d
