"""Held-out arithmetic in closed form.

Linearised at a fit, the residual of unit u is r_u - J_u d, so its sum of squares is c - 2 g·d +
d·G·d with c = r·r, g = Jᵀr, G = JᵀJ: all products of the columns of [r, J]. Once these are stored
per unit and observable, refitting without some units and predicting them takes only small solves:
cross-validation, jackknife and bootstrap cost no simulation.
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
    """Of units and observables (u, o), or of observables alone where it is summed (o,): `products`
    (..., p + 1, p + 1) of residual and Jacobian columns with each other, and `n` (...) samples.
    """

    products: Array
    n: Array

    @property
    def g(self) -> Array:
        """Jᵀr (..., p)."""
        return self.products[..., 0, 1:]

    @property
    def G(self) -> Array:  # noqa: N802  (as in the formula)
        """JᵀJ (..., p, p)."""
        return self.products[..., 1:, 1:]

    def error(self, d: Array) -> Array:
        """Sum of squares (...) after moving the parameters by `d` (p,)."""
        by = np.append(1.0, -d)
        return np.asarray(np.maximum((self.products @ by) @ by, 0.0))

    def mean(self, d: Array) -> Array:
        """Mean squares (...) after moving the parameters by `d` (p,)."""
        return np.asarray(self.error(d) / np.maximum(self.n, 1.0))

    def of(self, units: NDArray[np.bool_]) -> Quadratic:
        """Those of some units (u,)."""
        return Quadratic(self.products[units], self.n[units])

    def without(self, other: Quadratic) -> Quadratic:
        """The rest after taking `other` out."""
        return Quadratic(self.products - other.products, self.n - other.n)


def summed(quad: Quadratic) -> Quadratic:
    """Sum over the units."""
    return Quadratic(quad.products.sum(0), quad.n.sum(0))


def quadratic(
    residual: Array, jacobian: Array, runs: Sequence[Run], shape: tuple[int, int], weight: Array
) -> Quadratic:
    """Accumulate flat residual (size,) and Jacobian of the *prediction* (size, p) per unit and
    observable.

    `runs` are the stretches of samples of one unit and observable; samples that do not count have
    weight 0.
    """
    table = np.column_stack([residual, jacobian])
    products, n = np.zeros((*shape, table.shape[1], table.shape[1])), np.zeros(shape)
    for lo, hi, u, o in runs:
        part, w = table[lo:hi], weight[lo:hi]
        products[u, o] += (part * w[:, None]).T @ part
        n[u, o] += np.count_nonzero(w)
    return Quadratic(products, n)


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
    products = np.pad(quad.products, ((0, 0), (0, 0), (0, 1), (0, 1)))
    table = np.column_stack([residual, jacobian, column]) * (weight * column)[:, None]
    sums = np.add.reduceat(table, [lo for lo, *_ in runs], axis=0)
    np.add.at(products[..., -1, :], ([u for *_, u, _ in runs], [o for *_, o in runs]), sums)
    products[..., -1] = products[..., -1, :]
    return Quadratic(products, quad.n)


def unhidden(changes: Array, jacobian: Array) -> Array:
    """Inner products (m, m) of changes of a prediction (size, m), or the square of one (size,),
    where parameters with unit priors have moved along their `jacobian` (size, p) to hide them.
    """
    cross = jacobian.T @ changes
    gram = jacobian.T @ jacobian + np.eye(jacobian.shape[1])
    return np.asarray(changes.T @ changes - cross.T @ np.linalg.solve(gram, cross))


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
        d[free] = lsq_linear(root.T, wanted, box, method="bvls", max_iter=(count + 1) ** 2).x
    return d
