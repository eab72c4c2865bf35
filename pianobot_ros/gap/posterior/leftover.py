"""What a hypothesis leaves of the gap, and how much of it is systematic.

The gap of an observable is its squared held-out residual above the floor's square. Of a series that
is the mean of thousands of samples. Of an event it is the mean of a few dozen, and one stray note
would do: there only what a flexible regression predicts of held-out blocks (by condition, session
time and attributes, with a shrinkage prior) is systematic; the rest is a heavy tail of the noise,
unless more blocks are far off than chance brings.
"""

from __future__ import annotations

from collections.abc import Iterable
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.gap.fitting.dependence import explained_share
from pianobot_ros.gap.fitting.evidence import Evidence
from pianobot_ros.gap.floor.unrepeated import noise_share
from pianobot_ros.gap.posterior.verdict import unknown_probability
from pianobot_ros.gap.problem.constants import KNOTS, MOST, RUN_AWAY, SHRINKAGE
from pianobot_ros.gap.problem.problem import Cell, Problem
from pianobot_ros.gap.problem.types import Array
from pianobot_ros.gap.search.study import Entry, gaps

__all__ = ["common_noise", "excess", "material_part", "perhaps_noise", "unexplained"]


_SHARES: WeakKeyDictionary[Entry, dict[int, float]] = WeakKeyDictionary()
"""Shares of noise by observable that were asked for, as long as their hypotheses last: each is
asked for several times, and costs regressions.
"""


def excess(evidence: Evidence, entry: Entry, noise: Array | None = None) -> Array:
    """Systematic squared gap above the floor's square (o,) that a hypothesis leaves held out, in
    floors², where no more than so much is `noise` (:func:`common_noise`).
    """
    of_units = evidence.gauge.squares(entry.held_out)
    squares = np.nan_to_num(evidence.gauge.per_observable(of_units)) ** 2
    faulty = evidence.gauge.more_strays_than_chance(of_units)
    out = np.maximum(squares - 1.0, 0.0)
    for o in np.flatnonzero(out > evidence.options.calibration.material**2):
        if faulty[o]:
            continue
        if evidence.problem.observables[o].kind == "event":
            out[o] = min(out[o], _predictable(evidence, entry.held_out, int(o)))
        elif _unrepeated(evidence, int(o)):
            out[o] = min(out[o], squares[o] * (1.0 - _noise(evidence.problem, entry, int(o))))
    return out if noise is None else np.maximum(out, squares - np.maximum(noise, 1.0))


def common_noise(evidence: Evidence, entries: Iterable[Entry]) -> Array:
    """Squared gap (o,) of a series that nothing repeats that may be noise, in floors²: the least
    that any hypothesis leaves as such. It is the same for all of them, and what one of them
    predicts is none: by itself all that a worse one leaves might be. Infinite of all else.
    """
    out = np.full(len(evidence.problem.observables), np.inf)
    alone = [o for o in range(out.size) if _unrepeated(evidence, o)]
    for e in entries if alone else ():
        own = gaps(evidence, e) ** 2 - excess(evidence, e)
        out[alone] = np.minimum(out[alone], own[alone])
    return out


def material_part(evidence: Evidence, squares: Array) -> Array:
    """What of systematic squared gaps (o,) is beyond what is material."""
    return np.maximum(squares - evidence.options.calibration.material**2, 0.0)


def unexplained(evidence: Evidence, before: Array, rest: Array) -> dict[str, float]:
    """The gaps (floors) of observables in which something that the library lacks is the likelier
    cause of what a hypothesis leaves, by name, the largest first, by the excess `before` it, which
    refitting leaves, and the `rest` (o,): of all together that may be little where it explains most
    of another one.
    """
    c, found = evidence.options.calibration, {}
    left, whole = material_part(evidence, rest), material_part(evidence, before)
    for o in np.flatnonzero(left).tolist():
        share, worst = float(left[o] / max(whole[o], left[o])), float(np.sqrt(1.0 + rest[o]))
        if unknown_probability(c, share, worst) > MOST:
            found[evidence.problem.observables[o].name] = worst
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def perhaps_noise(evidence: Evidence, entry: Entry) -> tuple[str, ...]:
    """Names of the series that nothing repeats in which a hypothesis leaves more than the floor,
    most of which noise could be.
    """
    limit, problem = evidence.options.calibration.material**2, evidence.problem
    squares = gaps(evidence, entry) ** 2
    systematic = excess(evidence, entry)
    return tuple(
        problem.observables[o].name
        for o in np.flatnonzero(squares - 1.0 > np.maximum(limit, systematic / MOST)).tolist()
        if _unrepeated(evidence, o)
    )


def _hats(x: Array, knots: int) -> Array:
    """Piecewise linear basis (n, k) over x (n,), with knots at its quantiles."""
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, knots)))
    if edges.size < 2:
        return np.zeros((x.size, 0))
    return np.column_stack([np.interp(x, edges, top) for top in np.eye(edges.size)])


def _unrepeated(evidence: Evidence, o: int) -> bool:
    """Whether an observable is a series that was measured and that nothing repeats."""
    noise = evidence.fitter.noise.estimates.noises.get(o)
    series = evidence.problem.observables[o].kind == "series"
    return series and noise is not None and not noise.repeats


def _noise(problem: Problem, entry: Entry, o: int) -> float:
    """Share of an observable's held-out residual that may be noise."""
    known = _SHARES.setdefault(entry, {})
    if o not in known:
        dependent = explained_share(problem, entry.held_out, o)
        residual = problem.y - entry.held_out
        known[o] = noise_share(problem, problem.cells_of(o), residual, dependent)
    return known[o]


def _predictable(evidence: Evidence, prediction: Array, o: int) -> float:
    """Squares (floors²) by which a flexible regression lowers an event's held-out residual."""
    problem = evidence.problem
    cells = problem.cells_of(o)
    at = np.array([c.start for c in cells])
    r = np.clip(evidence.gauge.noise.normalise(problem.y - prediction)[at], -RUN_AWAY, RUN_AWAY)
    fold = np.unique(evidence.ways[0][problem.unit_of[at]], return_inverse=True)[1]
    if fold.max() < 1:
        return float(np.mean(r**2))
    basis = _basis(problem, cells)
    left = [_left(basis, r, fold, precision) for precision in SHRINKAGE]
    return max(float(np.mean(r**2)) - min(left), 0.0)


def _basis(problem: Problem, cells: list[Cell]) -> Array:
    """Level, conditions, session time and attributes of the cells' blocks (n, k)."""
    index = np.array([c.block for c in cells])
    blocks = [problem.blocks[i] for i in index]
    condition = problem.condition_of_block[index]
    columns = [
        np.ones((index.size, 1)),
        1.0 * (condition[:, None] == np.unique(condition)),
        _hats(problem.start_of_block[index], KNOTS),
    ]
    for name in sorted(set.intersection(*(set(b.attributes) for b in blocks))):
        x = np.array([float(b.attributes[name]) for b in blocks])
        if np.all(np.isfinite(x)):
            columns.append(_hats(x, KNOTS))
    return np.hstack(columns)


def _left(basis: Array, r: Array, fold: NDArray[np.intp], precision: float) -> float:
    """Mean square that ridge regression leaves of r (n,) in the folds it was not fitted to."""
    total = 0.0
    for k in range(int(fold.max()) + 1):
        train, test = basis[fold != k], basis[fold == k]
        gram = train.T @ train + precision * np.eye(basis.shape[1])
        left = r[fold == k] - test @ np.linalg.solve(gram, train.T @ r[fold != k])
        total += float(left @ left)
    return total / r.size
