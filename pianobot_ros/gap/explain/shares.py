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

from pianobot_ros.gap.problem.constants import LEADERS, NEGLIGIBLE, SAMPLES
from pianobot_ros.gap.problem.types import Array
from pianobot_ros.gap.search.study import Study


def stage_shares(study: Study) -> dict[str, float]:
    """Stage name to share; shares add up to 1 (all 0 where there is no gap)."""
    problem, each = study.problem, study.gauge.gaps(study.nominal)
    stages = [s.name for s in problem.twin.stages]
    own = dict.fromkeys(stages, 0.0)
    if not (each > 1.0).any():
        return own
    value = _coalition_values(study, np.nan_to_num(each, nan=1.0), stages)
    players = [s for s in stages if frozenset((s,)) in value]
    n = len(players)
    for s in players:
        rest = [x for x in players if x != s]
        for k in range(n):
            weight = factorial(k) * factorial(n - k - 1) / factorial(n)
            for coalition in combinations(rest, k):
                more = value[frozenset((*coalition, s))] - value[frozenset(coalition)]
                own[s] += weight * more
    total = sum(max(v, 0.0) for v in own.values()) or 1.0
    return {s: max(v, 0.0) / total for s, v in own.items()}


def _coalition_values(
    study: Study, each: Array, stages: Sequence[str]
) -> dict[frozenset[str], float]:
    problem, fitter, base = study.problem, study.fitter, study.entry("parameters").fit
    size = np.maximum(each, 1.0) * np.maximum(fitter.likelihood.count, 1.0)
    root = np.where(problem.mask, 1.0, 0.0) / np.sqrt(size)[problem.obs_of]
    z = fitter.noise.normalise(problem.y - study.nominal) * root
    jac = fitter.noise.normalise(base.jacobian) * root[:, None]
    columns = [jac[:, j] for j in range(jac.shape[1])]
    stage_of = [p.stage for p in base.space.parameters]
    count = dict.fromkeys(stages, 0)
    for s in study.screened:
        stage = problem.effects[s.effect].stage
        if count[stage] < LEADERS and s.gain > 0:
            columns.append(fitter.noise.normalise(s.change) * root)
            stage_of.append(stage)
            count[stage] += 1
    matrix = np.array(columns).T if columns else np.zeros((problem.size, 0))
    gram, rhs = matrix.T @ matrix, matrix.T @ z
    players = [s for s in stages if s in stage_of]
    players = players[: int(np.log2(SAMPLES))]  # no more coalitions than samples elsewhere
    out: dict[frozenset[str], float] = {}
    for k in range(len(players) + 1):
        for coalition in combinations(players, k):
            use = [j for j, s in enumerate(stage_of) if s in coalition or s not in stages]
            a = gram[np.ix_(use, use)] + NEGLIGIBLE * np.eye(len(use))
            out[frozenset(coalition)] = float(rhs[use] @ np.linalg.solve(a, rhs[use]))
    return out
