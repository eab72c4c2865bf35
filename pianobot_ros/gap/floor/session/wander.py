"""Whether levels that follow a course of the session only wander.

A sensor's gain that wanders for some seconds takes neighbouring repeats along, and by chance it is
high in one half of the session and low in the other. What is left beside the course does not tell:
the course has taken the wander with it. So a wander is fitted with the course and without it: white
scatter and an Ornstein-Uhlenbeck process, whose size and duration the levels themselves choose.
"""

from __future__ import annotations

import numpy as np

from pianobot_ros.gap.problem.constants import LASTING, SIZES
from pianobot_ros.gap.problem.types import Array

__all__ = ["left_beside_wander"]


def left_beside_wander(
    level: Array, course: Array, own: Array, sizes: Array, start: Array
) -> float:
    """Share (0 to 1) that a `course` (m, k) leaves of the squares of levels (m,), as far as a
    wander does not follow them as well: exp(-2 Λ / n) of the logarithm Λ of the restricted
    likelihood ratio (Patterson and Thompson 1971, Biometrika 58), n levels being free. White
    scatter alone makes it the usual share.

    `own` (m, g) orthonormal: the levels of groups, which are free; `sizes` (m, w): by how much each
    of some wanders, which know nothing of one another, moves each level; `start` (m,) s: when each
    was.
    """
    free = np.linalg.svd(own, full_matrices=True)[0][:, own.shape[1] :]
    apart = np.abs(start[:, None] - start)
    lasting = (float(np.ptp(start)) or 1.0) * np.asarray(LASTING)
    alike = np.exp(-apart / lasting[:, None, None]) * (sizes @ sizes.T)
    alike = free.T @ alike @ free / np.mean(np.sum(sizes**2, axis=1))
    n = free.shape[1]
    both = np.eye(n) + np.multiply.outer(np.asarray(SIZES), alike).reshape(-1, n, n)
    root = np.linalg.cholesky(both)
    white = np.linalg.solve(root, np.column_stack([free.T @ level, free.T @ course])[None])
    y, x = white[..., 0], white[..., 1:]
    u = np.linalg.svd(x, full_matrices=False)[0]
    alone = np.sum(y**2, axis=1)
    beside = alone - np.sum(np.einsum("tnk,tn->tk", u, y) ** 2, axis=1)
    spread = 2.0 * np.log(np.diagonal(root, axis1=1, axis2=2)).sum(1) / n
    least = np.finfo(float).tiny
    costs = [float(np.min(np.log(np.maximum(s, least)) + spread)) for s in (alone, beside)]
    return float(np.exp(min(costs[1] - costs[0], 0.0)))
