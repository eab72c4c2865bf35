"""Wanders of the session: whether levels that follow a course only wander, and what repeats that
follow each other closely do not show of one.

A sensor's gain that wanders for some seconds takes neighbouring repeats along, and by chance it is
high in one half of the session and low in the other. What is left beside the course does not tell:
the course has taken the wander with it. So a wander is fitted with the course and without it: white
scatter and an Ornstein-Uhlenbeck process, whose size and duration the levels themselves choose.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pianobot_ros.gap.problem.constants import HUBER, LASTING, OF_MEDIAN, SIZES
from pianobot_ros.gap.problem.types import Array

__all__ = ["growth", "left_beside_wander", "without_far"]


def without_far(x: Array) -> Array:
    """Levels (m,) about nothing, none further than `HUBER` robust standard deviations: a stray is
    no wander, and no course.
    """
    limit = HUBER * OF_MEDIAN * float(np.median(np.abs(x)))
    return np.clip(x, -limit, limit) if limit > 0.0 else x


def left_beside_wander(
    level: Array, course: Array, own: Array, sizes: Array, start: Array
) -> float:
    """Share (0 to 1) that a `course` (m, k) leaves of the squares of levels (m,), as far as a
    wander does not follow them as well: exp(-2 Λ / n) of the logarithm Λ of the restricted
    likelihood ratio, n levels being free. White scatter alone makes it the usual share. The rest as
    in :func:`_costs`.
    """
    lasting = (float(np.ptp(start)) or 1.0) * np.asarray(LASTING)
    alone, beside = _costs(level, course, own, sizes, start, lasting)
    return float(np.exp(min(beside.min() - alone.min(), 0.0)))


def growth(groups: Sequence[tuple[Array, Array]], starts: Array) -> float:
    """By how much (1 and more) the variance of blocks that lie as far apart as those of the session
    exceeds what repeats show of it, which may lie closer: a cell that wanders for seconds is nearly
    the same in repeats that follow each other, and another one where the next condition is played.

    `groups` of repeats: when each was (m,), s, and its residual (m, n); `starts` (b,), s, of all
    blocks. The variogram of the repeats (what two of them differ by, over the time between them),
    along the shape in which they differ most, is that of white scatter and an Ornstein-Uhlenbeck
    process. What its size and duration are is left open: all are averaged by the restricted
    likelihood, and "no wander" is as likely as any beforehand. Where repeats lie as far apart as
    other blocks, nothing grows.
    """
    rows = [x - x.mean(0) for _, x in groups]
    whole = sum(float(np.sum(x**2)) for x in rows)
    if not whole > 0.0:
        return 1.0
    level = np.concatenate([x @ np.linalg.svd(x, full_matrices=False)[2][0] for x in rows])
    counts = [at.size for at, _ in groups]
    members = np.repeat(np.eye(len(counts)), counts, axis=0)
    lasting = (float(np.ptp(starts)) or 1.0) * np.asarray(LASTING)
    own, at = members / np.sqrt(counts), np.concatenate([at for at, _ in groups])
    cost, _ = _costs(without_far(level), np.zeros((at.size, 0)), own, members, at, lasting)
    shown = np.average([_variance(at, lasting) for at, _ in groups], axis=0, weights=counts)
    grown = np.maximum(_variance(starts, lasting) / shown, 1.0)
    weight = np.exp(-0.5 * (at.size - len(counts)) * (cost - cost.min()))
    once = slice(len(LASTING) - 1, None)  # "no wander" is the same however long it lasts
    share = float(level @ level) / whole
    return 1.0 + share * float(np.average(grown[once] - 1.0, weights=weight[once]))


def _variance(start: Array, lasting: Array) -> Array:
    """Variance that levels at these times (m,), s, show under each wander that is tried (t,), in
    that of white scatter.
    """
    apart = np.abs(start[:, None] - start)[~np.eye(start.size, dtype=bool)]
    differ = np.mean(1.0 - np.exp(-apart / lasting[:, None]), axis=1)
    return np.asarray(1.0 + np.multiply.outer(SIZES, differ).ravel())


def _costs(
    level: Array, course: Array, own: Array, sizes: Array, start: Array, lasting: Array
) -> tuple[Array, Array]:
    """Minus twice the restricted log likelihood (Patterson and Thompson 1971, Biometrika 58) of
    levels (m,), by the number of those that are free, alone and beside a `course` (m, k): under
    white scatter and each wander that is tried (t,), which has one of `SIZES` (variance in that of
    the scatter) and is `lasting` (s).

    `own` (m, g) orthonormal: the levels of groups, which are free; `sizes` (m, w): by how much each
    of some wanders, which know nothing of one another, moves each level; `start` (m,) s: when each
    was.
    """
    free = np.linalg.svd(own, full_matrices=True)[0][:, own.shape[1] :]
    apart = np.abs(start[:, None] - start)
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
    return np.log(np.maximum(alone, least)) + spread, np.log(np.maximum(beside, least)) + spread
