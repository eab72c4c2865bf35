"""Held-out arithmetic in closed form.

Linearised at a fit, the residual of unit u is r_u - J_u d, so its sum of squares is c - 2 g·d + d·G·d with c = r·r,
g = Jᵀr, G = JᵀJ. Once these are stored per unit and observable, refitting without some units and predicting them takes
only small solves: cross-validation, jackknife and bootstrap cost no simulation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pianobot_ros.gap.types import Array


@dataclass(frozen=True)
class Quadratic:
    """c (u, o), g (u, o, p), G (u, o, p, p), and n (u, o) samples: `u` units, `o` observables, `p` parameters."""

    c: Array
    g: Array
    G: Array
    n: Array

    def error(self, d: Array) -> Array:
        """Sum of squares (u, o) after moving the parameters by `d` (p,)."""
        return np.asarray(np.maximum(self.c - 2 * self.g @ d + np.einsum("uoij,i,j->uo", self.G, d, d), 0.0))


def quadratic(residual: Array, jacobian: Array, unit_of: Array, obs_of: Array, shape: tuple[int, int],
              weight: Array | None = None, mask: Array | None = None) -> Quadratic:  # fmt: skip
    """Accumulate flat residual (size,) and Jacobian of the *prediction* (size, p) per unit and observable."""
    units, observables = shape
    p = jacobian.shape[1]
    key = unit_of * observables + obs_of
    if mask is not None:
        residual, jacobian, key = residual[mask], jacobian[mask], key[mask]
        weight = weight[mask] if weight is not None else None
    order = np.argsort(key, kind="stable")
    key, residual, jacobian = key[order], residual[order], jacobian[order]
    root = np.ones(residual.size) if weight is None else np.sqrt(weight[order])
    residual, jacobian = residual * root, jacobian * root[:, None]
    c = np.zeros(units * observables)
    n = np.zeros(units * observables)
    g = np.zeros((units * observables, p))
    big = np.zeros((units * observables, p, p))
    groups, starts = np.unique(key, return_index=True)
    for k, lo, hi in zip(groups, starts, np.append(starts[1:], key.size), strict=True):
        r, jac = residual[lo:hi], jacobian[lo:hi]
        c[k], g[k], big[k], n[k] = r @ r, jac.T @ r, jac.T @ jac, hi - lo
    return Quadratic(c.reshape(units, observables), g.reshape(units, observables, p),
                     big.reshape(units, observables, p, p), n.reshape(units, observables))  # fmt: skip


def extend(quad: Quadratic, residual: Array, jacobian: Array, column: Array, unit_of: Array, obs_of: Array,
           weight: Array) -> Quadratic:  # fmt: skip
    """`quad` with one more Jacobian column (size,), at the price of one column (all arrays flat, masked samples 0)."""
    units, observables = quad.c.shape
    p = quad.g.shape[2]
    key = unit_of * observables + obs_of
    size = units * observables
    weighted = weight * column

    def total(x: Array) -> Array:
        return np.asarray(np.bincount(key, x, minlength=size), float).reshape(units, observables)

    g = np.empty((units, observables, p + 1))
    big = np.empty((units, observables, p + 1, p + 1))
    g[..., :p], big[..., :p, :p] = quad.g, quad.G
    g[..., p] = total(weighted * residual)
    for j in range(p):
        if np.any(jacobian[:, j]):
            big[..., j, p] = big[..., p, j] = total(weighted * jacobian[:, j])
        else:
            big[..., j, p] = big[..., p, j] = 0.0
    big[..., p, p] = total(weighted * column)
    return Quadratic(quad.c, g, big, quad.n)


def solve_map(big: Array, g: Array, prior_offset: Array, low: Array, high: Array, prior: float = 1.0) -> Array:
    """Step d minimising d·G·d - 2 g·d + prior |prior_offset + d|² within the box [low, high], which must hold 0.

    A primal active-set method: the cost never rises, active bounds are released when their multiplier asks for it.
    """
    p = g.size
    a = big + prior * np.eye(p)
    b = g - prior * prior_offset
    d = np.clip(np.zeros(p), low, high)
    free = high > low
    for _ in range(3 * p + 5):
        target = d.copy()
        if free.any():
            target[free] = _solve(a[np.ix_(free, free)], b[free] - a[np.ix_(free, ~free)] @ d[~free])
        step = target - d
        with np.errstate(divide="ignore", invalid="ignore"):
            room = np.where(step > 0, (high - d) / step, np.where(step < 0, (low - d) / step, np.inf))
        room[~free] = np.inf
        alpha = float(min(1.0, np.min(room, initial=np.inf)))
        d = np.clip(d + max(alpha, 0.0) * step, low, high)
        if alpha < 1.0:
            free[int(np.argmin(room))] = False
            continue
        slope = a @ d - b  # half the gradient; a bound is kept only while the cost falls towards it
        pull = np.where(free | (high <= low), 0.0, np.where(d >= high, slope, -slope))
        worst = int(np.argmax(pull))
        if pull[worst] <= 1e-9 * (1.0 + np.max(np.abs(b), initial=0.0)):
            break
        free[worst] = True
    return d


def _solve(a: Array, b: Array) -> Array:
    try:
        return np.asarray(np.linalg.solve(a, b))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(a, b, rcond=None)[0])
