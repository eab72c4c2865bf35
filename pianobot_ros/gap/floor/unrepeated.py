"""The floor where nothing repeats.

The white part of the noise is seen in second differences of the residual, which few gaps have.

A prediction is made from what was measured upstream, so it repeats no better than that: the noise
of an encoder goes through the twin's belt and comes out slower, larger and correlated. That needs
no repeats: the noise of each measured signal is drawn anew, the twin predicts once more, and what
changes is what one repeat would have differed by (propagation of distributions by a Monte Carlo
method, JCGM 101:2008, 5.9).

What repeats differ by in the machine itself no draw can tell: the wind that blows otherwise each
time. It is seen at the end alone, in what the best hypothesis leaves: noise is as large at all
times, and depends on nothing that is known.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np

from pianobot_ros.gap.floor.repeats import second_difference, second_differences, split
from pianobot_ros.gap.problem.constants import DRAWS, LEVEL, OF_MEDIAN, PIECES, SMALL, TINY
from pianobot_ros.gap.problem.errors import SimulationFailed
from pianobot_ros.gap.problem.problem import Cell, Problem
from pianobot_ros.gap.problem.types import Array, Block, Signal


def white_alone(problem: Problem, cells: list[Cell], residual: Array) -> float:
    """Robust white sigma from second differences of the residual (differences would keep too much
    of the gap).
    """
    spread = [np.abs(second_differences(x)) for x in _rows(problem, cells, residual)]
    return float(OF_MEDIAN * np.median(np.concatenate(spread))) if spread else 0.0


def drawn_anew(
    problem: Problem, residual: Array, values: Mapping[str, float] | None
) -> Array | None:
    """What residuals change by where the noise of all signals is drawn anew (size,), by these
    `values` of the parameters: 0 for observables whose prediction does not. None where conditions
    repeat, or the twin cannot simulate that.
    """
    if values is None or np.bincount(problem.condition_of_block).max() > 1:
        return None
    white: dict[str, float] = {}
    for o in problem.present:
        obs = problem.observables[o]
        if obs.kind == "series":
            own = white_alone(problem, problem.cells_of(o), residual)
            white[obs.signal] = min(own, white.get(obs.signal, np.inf))
    rng = np.random.default_rng(0)
    blocks = [noisy(b, white, rng) for b in problem.blocks]
    drawn = problem.predict_blocks(dict(enumerate(blocks)), values)
    if isinstance(drawn, SimulationFailed):
        return None
    measured = {o.name: o.signal for o in problem.observables if o.kind == "series"}
    read = [
        {name: b.outputs[s].y for name, s in measured.items() if s in b.outputs} for b in blocks
    ]
    change = drawn - problem.predict(values, ())
    noise = problem.flattened(read) - problem.y
    moved = np.bincount(problem.obs_of, np.abs(change), len(problem.observables)) > 0.0
    used = problem.mask & np.isfinite(noise) & moved[problem.obs_of]
    return np.where(used, noise - change, 0.0)


def shaped(
    problem: Problem, cells: list[Cell], noise: Array, white: float
) -> tuple[float, float, float]:
    """White sigma, correlated sigma and correlation time (s) of `noise` (size,) that was drawn, as
    large as its fast part must be to make the `white` that was seen.
    """
    rows = _rows(problem, cells, noise)
    fast = float(np.sqrt(np.mean([second_difference(r) for r in rows]))) if rows else 0.0
    if fast <= 0.0:
        return white, 0.0, 1.0
    return split([white / fast * r for r in rows], [c.t for c in cells])


def noise_share(problem: Problem, cells: list[Cell], residual: Array, dependent: float) -> float:
    """Share of a residual's (size,) power that is like noise: nothing that is `dependent` on what
    is known, nothing beyond what as many blocks of the most uneven noise, random walks, have beside
    their median piece but by chance, and nothing beyond what machines repeat their motions by.
    """
    rows = _rows(problem, cells, residual)
    if not rows:
        return 0.0
    whole = float(np.mean(np.concatenate(rows) ** 2))
    pieces = [x for r in rows for x in np.array_split(r, min(PIECES, r.size // 4)) if x.size]
    even = uneven(len(rows)) * float(np.median([np.mean(x**2) for x in pieces]))
    most = (SMALL * float(np.std(np.concatenate(_rows(problem, cells, problem.y))))) ** 2
    return float(min(min(even, most) / max(whole, TINY), 1.0 - max(dependent, 0.0), 1.0))


@cache
def uneven(count: int) -> float:
    """Mean power of so many random walks over the median of their pieces, which chance alone
    (1 - `LEVEL`) exceeds. Of few walks one that went far makes the mean alone.
    """
    rng = np.random.default_rng(0)
    ratios = []
    for _ in range(DRAWS):
        walks = np.cumsum(rng.normal(size=(count, 10 * PIECES)), axis=1)
        pieces = np.mean(walks.reshape(count * PIECES, -1) ** 2, axis=1)
        ratios.append(float(np.mean(pieces) / np.median(pieces)))
    return float(np.quantile(ratios, LEVEL))


def _rows(problem: Problem, cells: list[Cell], flat: Array) -> list[Array]:
    """Samples of each cell that are judged, where there are some."""
    return [r for r in (problem.judged(c, flat) for c in cells) if r.size > 4]


def noisy(block: Block, white: Mapping[str, float], rng: np.random.Generator) -> Block:
    """The block with further noise, `white` RMS by measured signal."""
    outputs = {
        name: Signal(s.t, s.y + white.get(name, 0.0) * rng.standard_normal(s.y.size), s.unit)
        for name, s in block.outputs.items()
    }
    return replace(block, outputs=outputs)
