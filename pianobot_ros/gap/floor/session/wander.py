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

__all__ = ["growth", "left_beside_wander"]


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
    rows = [(at, x - x.mean(0)) for at, x in groups]
    whole = sum(float(np.sum(x**2)) for _, x in rows)
    if not whole > 0.0:
        return 1.0
    level = [x @ np.linalg.svd(x, full_matrices=False)[2][0] for _, x in rows]
    share = sum(float(y @ y) for y in level) / whole
    usual = HUBER * OF_MEDIAN * float(np.median(np.abs(np.concatenate(level))))
    if usual > 0.0:  # a stray is no wander
        level = [np.clip(y, -usual, usual) for y in level]
    told = [(at, y, _contrasts(at.size)) for (at, _), y in zip(rows, level, strict=True)]
    lasting = [(float(np.ptp(starts)) or 1.0) * x for x in LASTING]
    wanders = [(size, time) for size in SIZES if size > 0.0 for time in lasting]
    tried = [(0.0, lasting[0]), *wanders]
    cost, shown = np.array([_variogram(told, *w) for w in tried]).T
    apart = np.abs(starts[:, None] - starts)[~np.eye(starts.size, dtype=bool)]
    there = np.array([1.0 + size * float(np.mean(1.0 - np.exp(-apart / t))) for size, t in tried])
    grown = np.maximum(there / shown, 1.0)
    weight = np.exp(-0.5 * (cost - cost.min())) / np.append(len(wanders), np.ones(len(wanders)))
    return 1.0 + share * float(weight @ (grown - 1.0) / weight.sum())


def _variogram(
    groups: Sequence[tuple[Array, Array, Array]], size: float, lasting: float
) -> tuple[float, float]:
    """Minus twice the restricted log likelihood of levels (m,) at their times (m,), s, by their
    contrasts, under white scatter and a wander of this `size` (variance in that of the scatter),
    `lasting` s; and the variance that such levels show, in that of the scatter.
    """
    squares = spread = shown = 0.0
    free, count = sum(len(c) for *_, c in groups), sum(at.size for at, *_ in groups)
    for at, level, contrasts in groups:
        alike = np.exp(-np.abs(at[:, None] - at) / lasting)
        both = contrasts @ (np.eye(at.size) + size * alike) @ contrasts.T
        root = np.linalg.cholesky(both)
        squares += float(np.sum(np.linalg.solve(root, contrasts @ level) ** 2))
        spread += 2.0 * float(np.log(np.diagonal(root)).sum())
        shown += at.size * float(np.trace(both)) / len(both)
    cost = free * float(np.log(max(squares, np.finfo(float).tiny))) + spread
    return cost, shown / count


def _contrasts(count: int) -> Array:
    """Orthonormal contrasts (count - 1, count) of repeats: what is left without their mean."""
    whole = np.linalg.svd(np.ones((count, 1)), full_matrices=True)[0]
    return np.asarray(whole[:, 1:].T)
