"""How much of the gap each stage is answerable for: Shapley values over coalitions of stages.

The value of a coalition is the drop of the gap (square over size in floor units, linearised, every
observable alike) when
only its stages may change: their parameters and their best-screened effects. Substitutes share,
complements gain, and a stage that can explain nothing gets nothing (Weilbach 2024 uses the same
values over replaced modules).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from math import factorial

import numpy as np

from pianobot_ros.gap.fitting.fit import Fit, Fitter
from pianobot_ros.gap.floor.measure import Gauge
from pianobot_ros.gap.problem.problem import Problem
from pianobot_ros.gap.problem.types import Array
from pianobot_ros.gap.search.screening import Screened


def stage_shares(
    problem: Problem,
    fitter: Fitter,
    gauge: Gauge,
    base: Fit | None,
    screened: Sequence[Screened],
    nominal: Array,
    per_stage: int = 3,
) -> dict[str, float]:
    """Stage name to share; shares add up to 1 (all 0 where there is no gap)."""
    stages = [s.name for s in problem.twin.stages]
    own = dict.fromkeys(stages, 0.0)
    each = gauge.gaps(nominal)
    for o in problem.present:
        own[problem.stage_of(o)] += max(0.0, float(each[o]) ** 2 - 1.0)
    total = sum(own.values())
    if total <= 0 or base is None:
        return {s: (v / total if total > 0 else 0.0) for s, v in own.items()}
    value = _coalition_values(
        problem, fitter, base, screened, nominal, np.nan_to_num(each, nan=1.0), stages, per_stage
    )
    players = [s for s in stages if s in value]
    n = len(players)
    shapley: dict[str, float] = dict.fromkeys(stages, 0.0)
    for s in players:
        rest = [x for x in players if x != s]
        for k in range(n):
            weight = factorial(k) * factorial(n - k - 1) / factorial(n)
            for coalition in combinations(rest, k):
                with_s = value["+".join(sorted((*coalition, s)))]
                shapley[s] += weight * (with_s - value["+".join(sorted(coalition))])
    positive = {s: max(v, 0.0) for s, v in shapley.items()}
    total = sum(positive.values())
    return {s: (v / total if total > 0 else 0.0) for s, v in positive.items()}


def _coalition_values(
    problem: Problem,
    fitter: Fitter,
    base: Fit,
    screened: Sequence[Screened],
    nominal: Array,
    each: Array,
    stages: list[str],
    per_stage: int,
) -> dict[str, float]:
    z = fitter.noise.normalise(problem.y - nominal)
    size = np.maximum(each, 1.0) * np.maximum(fitter.likelihood.count, 1.0)
    root = np.where(problem.mask, 1.0, 0.0) / np.sqrt(size)[problem.obs_of]
    z = z * root
    jac = fitter.noise.normalise(base.jacobian) * root[:, None]
    columns = [jac[:, j] for j in range(jac.shape[1])]
    stage_of = [p.stage for p in base.space.parameters]
    count: dict[str, int] = {}
    for s in screened:
        stage = problem.effects[s.effect].stage
        if count.get(stage, 0) < per_stage and s.gain > 0:
            columns.append(fitter.noise.normalise(s.change) * root)
            stage_of.append(stage)
            count[stage] = count.get(stage, 0) + 1
    matrix = np.array(columns).T if columns else np.zeros((problem.size, 0))
    gram, rhs = matrix.T @ matrix, matrix.T @ z
    players = [s for s in stages if s in stage_of][:10]
    always = np.array([s not in stages for s in stage_of], bool)
    out: dict[str, float] = {}
    for k in range(len(players) + 1):
        for coalition in combinations(players, k):
            use = np.flatnonzero(always | np.array([s in coalition for s in stage_of], bool))
            drop = 0.0
            if use.size:
                a = gram[np.ix_(use, use)] + 0.01 * np.eye(use.size)
                drop = float(rhs[use] @ np.linalg.solve(a, rhs[use]))
            out["+".join(sorted(coalition))] = drop
    return out
