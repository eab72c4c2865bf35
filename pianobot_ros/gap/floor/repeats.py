"""Which cells are repeats of each other, their residuals side by side, and whether what sets them
apart is more than chance.

Blocks of one condition are repeats, whatever came before them, unless what came before shows: where
repeats of different histories differ by more than repeats of one history scatter, only the latter
count.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import betainc, chdtrc

from pianobot_ros.gap.problem.constants import CHANCE, MOST, NEGLIGIBLE, SMALL, TINY
from pianobot_ros.gap.problem.problem import Cell, Index, Problem
from pianobot_ros.gap.problem.types import Array, usable


@dataclass(frozen=True)
class Repeats:
    """Repeats (m,) of one observable in the order of time, side by side: the `times` (n,) of the
    `shortest` where the twin predicts, and the flat indices `at` (m, n) of the samples of each that
    are nearest to these.

    Interpolation would average neighbours and make noise look smaller; and by their number samples
    lie apart behind one that is lost.
    """

    cells: list[Cell]
    shortest: Cell
    times: Array
    at: Index

    def apart(self, residual: Array) -> Array:
        """What sets each apart from their mean (m, n), by a residual (size,)."""
        rows = residual[self.at]
        return np.asarray(rows - rows.mean(0))

    def scatter(self, residual: Array) -> Array:
        """The same with the n/(n-1) correction."""
        return self.apart(residual) * float(np.sqrt(len(self.at) / (len(self.at) - 1)))

    def of(self, chosen: NDArray[np.bool_]) -> Repeats:
        """Those of them that are `chosen` (m,)."""
        cells = [self.cells[k] for k in np.flatnonzero(chosen)]
        return replace(self, cells=cells, at=self.at[chosen])


def repeats(problem: Problem, cells: list[Cell], residual: Array) -> list[Repeats]:
    """Repeats of one observable; cells without repeats are left out. The twin predicts something of
    every one of the `cells`.
    """
    plain, by_history = (
        _grouped(problem, cells, of) for of in (problem.condition_of_block, problem.repeat_of_block)
    )
    return by_history if _history_shows(problem, plain, residual) else plain


def side_by_side(problem: Problem, cells: list[Cell]) -> Repeats:
    """Two cells or more of one observable as repeats. The twin predicts something of each."""
    cells = sorted(cells, key=lambda c: start_of(problem, c))
    shortest = min(cells, key=lambda c: c.t[-1] - c.t[0])
    times = shortest.t[problem.mask[shortest.start : shortest.stop]]
    local, rows = times - start_of(problem, shortest), []
    for c in cells:
        use = np.flatnonzero(problem.mask[c.start : c.stop])
        rows.append(c.start + use[_nearest(local, c.t[use] - start_of(problem, c))])
    return Repeats(cells, shortest, times, np.array(rows))


def lie_close(problem: Problem) -> bool:
    """Whether blocks of one condition follow each other: they lie less than half as far apart in
    time as any two of the session do, so that they do not show how slowly the robot wanders.
    """
    starts, condition = problem.start_of_block, problem.condition_of_block
    apart = np.abs(starts[:, None] - starts)
    alike = (condition[:, None] == condition) & ~np.eye(starts.size, dtype=bool)
    whole = float(apart.sum()) / max(starts.size * (starts.size - 1), 1)
    return bool(alike.any() and float(np.mean(apart[alike])) < MOST * whole)


def unshared_inputs(problem: Problem) -> dict[str, Array]:
    """Inputs by which repeats of a condition vary (variance) by most of what all blocks that repeat
    vary by, with their mean in every block (blocks,): no command, but something else that was
    recorded (a wind).
    """
    condition = problem.condition_of_block
    repeated = np.bincount(condition)[condition] > 1
    group, out = condition[repeated], dict[str, Array]()
    inputs = [b.inputs for b in problem.blocks] if repeated.any() else []
    for name in sorted(set.intersection(*map(set, inputs))) if inputs else []:
        values = [each[name].y[usable(each[name])] for each in inputs]
        if not all(y.size for y in values):
            continue
        known = np.array([y.mean() for y in values])
        level = known[repeated]
        common = np.bincount(group, level)[group] / np.bincount(group)[group]
        within = float(np.sum((level - common) ** 2)) / (group.size - np.unique(group).size)
        noise = (SMALL * float(np.concatenate(values).std())) ** 2
        if within > max(MOST * float(level.var(ddof=1)), noise):
            out[name] = known
    return out


def set_apart(problem: Problem, o: int, residual: Array) -> list[Repeats]:
    """All repeats of one observable by their residuals (size,); empty where nothing sets them
    apart.
    """
    cells = [c for c in problem.cells_of(o) if not c.absent]
    groups = repeats(problem, cells, residual)
    return groups if any(g.apart(residual).any() for g in groups) else []


def start_of(problem: Problem, cell: Cell) -> float:
    """When a cell's block begins, s: its first phase, else its first sample."""
    starts = [p[0] for p in problem.blocks[cell.block].phases.values()]
    return max(min(starts, default=-np.inf), float(cell.t[0]))


def second_differences(x: Array) -> Array:
    """Second differences (n - 2,) of x (n,), of which those of white noise are as large as it."""
    return np.asarray(np.diff(x, 2) / np.linalg.norm((1, -2, 1)))


def second_difference(x: Array) -> float:
    """Mean square of the white part of x (n,), by its second differences."""
    return float(np.mean(second_differences(x) ** 2)) if x.size > 2 else 0.0


def split(rows: list[Array], times: list[Array]) -> tuple[float, float, float]:
    """White sigma, correlated sigma and correlation time (s) of rows of scatter (n,), by their
    autocovariance; `times` (n,) of such rows, s.
    """
    duration = float(np.median([t[-1] - t[0] for t in times]))
    total = float(np.mean([np.mean(r**2) for r in rows]))
    white2 = min(float(np.mean([second_difference(r) for r in rows])), total)
    correlated2 = total - white2
    tau = 0.2 * duration
    if correlated2 > NEGLIGIBLE * total:
        n = min(r.size for r in rows)
        lags = np.unique(np.geomspace(1, max(2, n // 2), 24).astype(int))
        lags = lags[lags < n]
        covariance = np.array([np.mean([np.mean(r[k:] * r[:-k]) for r in rows]) for k in lags])
        dt = float(np.median(np.concatenate([np.diff(t) for t in times])))
        taus = np.geomspace(dt, 10 * max(duration, dt), 40)
        misfit = [
            float(np.sum((covariance - correlated2 * np.exp(-lags * dt / x)) ** 2)) for x in taus
        ]
        tau = float(taus[int(np.argmin(misfit))])
    return float(np.sqrt(white2)), float(np.sqrt(max(correlated2, 0.0))), tau


def _grouped(problem: Problem, cells: list[Cell], group_of_block: Index) -> list[Repeats]:
    groups: dict[int, list[Cell]] = {}
    for c in cells:
        groups.setdefault(int(group_of_block[c.block]), []).append(c)
    return [side_by_side(problem, g) for g in groups.values() if len(g) > 1]


def _history_shows(problem: Problem, groups: list[Repeats], residual: Array) -> bool:
    """Whether repeats of different histories differ by more than repeats of one history scatter: an
    analysis of variance within each condition, since some scatter far more than others, and their
    probabilities combined (Fisher 1932, *Statistical methods for research workers*, 21.1).
    """
    chances: list[float] = []
    for g in groups:
        history = [problem.repeat_of_block[c.block] for c in g.cells]
        _, label = np.unique(history, return_inverse=True)
        between, within = int(label.max()), int(label.size - label.max() - 1)
        apart = g.apart(residual)
        inner = apart @ apart.T
        mean = np.eye(between + 1)[label] / np.sqrt(np.bincount(label))
        known, total = float(np.einsum("ik,ij,jk->", mean, inner, mean)), float(np.trace(inner))
        if between and within and total > 0.0:
            left = max(1.0 - known / total, TINY)
            chances.append(float(betainc(0.5 * within, 0.5 * between, left)))
    with np.errstate(divide="ignore"):
        combined = -2.0 * float(np.sum(np.log(chances)))
    return bool(chances) and bool(chdtrc(2 * len(chances), combined) <= CHANCE)


def _nearest(at: Array, t: Array) -> Index:
    """Indices (m,) of the times (n,) nearest to `at` (m,)."""
    right = np.clip(np.searchsorted(t, at), 1, max(t.size - 1, 1))
    left = right - 1
    right = np.minimum(right, t.size - 1)
    return np.asarray(np.where(at - t[left] < t[right] - at, left, right))
