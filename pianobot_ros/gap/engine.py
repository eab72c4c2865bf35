"""`diagnose`: where the gap lies, which effect causes it, and how far it shrinks. The order of work
is the file's order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pianobot_ros.gap.diagnosis import Diagnosis
from pianobot_ros.gap.explain.conclude import conclude
from pianobot_ros.gap.explain.experiment import propose_experiment
from pianobot_ros.gap.explain.progress import say
from pianobot_ros.gap.fitting.fit import Fit
from pianobot_ros.gap.problem.budget import BLOCKS, Budget
from pianobot_ros.gap.problem.constants import CALLS_OF_A_FIT, LEADERS
from pianobot_ros.gap.problem.options import Options
from pianobot_ros.gap.problem.types import Block, Twin
from pianobot_ros.gap.search.contenders import leaders
from pianobot_ros.gap.search.grow import (
    fit_shortlist,
    grow,
    look_again,
    look_beside,
    screened,
    starts,
)
from pianobot_ros.gap.search.guesses import try_guesses
from pianobot_ros.gap.search.opening import open_study
from pianobot_ros.gap.search.parameters import (
    fit_parameters,
    judge_at,
    lower_floor,
    rescore,
)
from pianobot_ros.gap.search.screening import signatures
from pianobot_ros.gap.search.settle import settle
from pianobot_ros.gap.search.study import (
    Progress,
    Study,
    anything,
    material,
    prior_cost,
    simulate_folds,
)


def diagnose(
    twin: Twin,
    blocks: Sequence[Block],
    *,
    seed: int = 0,
    budget: int = BLOCKS,
    jobs: int = 1,
    options: Options | None = None,
    experiments: Sequence[Block] = (),
    progress: Progress | None = None,
) -> Diagnosis:
    """Diagnose the gap between `blocks` as measured and `twin`.

    `experiments` are blocks that could be recorded next (inputs as they would be; outputs give the
    time stamps): the one that best separates the leading hypotheses becomes `next_experiment`.

    `budget` is in simulated blocks (strikes) and is honoured by refining fewer effects, so the same
    data, options and `seed` give the same answer on any machine; `Options.limit` s of wall time
    are an emergency brake, and a warning says when it struck. `jobs` processes call the twin in
    parallel. `progress` is called with how far it is and who leads. Raises GapError when twin and
    blocks do not fit together.
    """
    study = investigate(
        twin,
        blocks,
        Budget(budget, (options or Options()).limit),
        seed=seed,
        jobs=jobs,
        options=options,
        progress=progress,
    )
    say(study, "weighing the hypotheses", 0.95)
    return _with_experiment(twin, conclude(study), experiments)


def investigate(
    twin: Twin,
    blocks: Sequence[Block],
    budget: Budget,
    *,
    seed: int = 0,
    jobs: int = 1,
    options: Options | None = None,
    progress: Progress | None = None,
) -> Study:
    """Put on the table whatever may explain the gap, not yet weighed (see :func:`diagnose`)."""
    study = open_study(twin, blocks, seed, budget, jobs, options or Options())
    study.progress = progress
    say(study, "refitting parameters", 0.0)
    base = fit_parameters(study)
    if not anything(study):
        return study
    say(study, "screening effects", 0.2)
    names = list(study.options.only or study.problem.effects)
    study.signatures = signatures(study.problem, base, starts(study, names))
    study.screened = screened(study, base, study.signatures)
    implausible = prior_cost(base) > study.options.calibration.implausible
    if implausible or material(study, study.entry("parameters").held_out):
        _fit_effects(study, base, names)
    return study


def _with_experiment(twin: Twin, diagnosis: Diagnosis, experiments: Sequence[Block]) -> Diagnosis:
    if not experiments:
        return diagnosis
    proposals = propose_experiment(twin, diagnosis, experiments)
    if not proposals:
        return diagnosis
    typical = float(np.median([p.gain for p in proposals]))
    return replace(diagnosis, next_experiment=proposals[0].to_json(typical))


def _fit_effects(study: Study, base: Fit, names: list[str]) -> None:
    """Put effects on the table, singly and in pairs, until none is likely to be missing."""
    options = study.options
    try_guesses(study, names, CALLS_OF_A_FIT)

    def tell(doing: str, share: float) -> None:
        say(study, doing, 0.3 + 0.2 * share)

    fit_shortlist(study, base, study.screened, options.shortlist, tell)
    say(study, "looking again from the nominal parameters", 0.5)
    look_again(study, names)
    if len(study.entries) <= 2:
        return
    say(study, "fitting the leaders until they converge", 0.6)
    settle(study)
    look_beside(study)
    settle(study)
    if lower_floor(study):
        settle(study)
    judge_at(study, leaders(study)[0])
    say(study, "looking for a further effect", 0.7)
    for _ in range(options.max_effects - 1):
        if not grow(study, names):
            break
    say(study, "fitting the leaders until they converge", 0.85)
    settle(study)
    rescore(study)
    _verify(study)


def _verify(study: Study) -> None:
    """Simulate the folds of the hypotheses that may lead by score, or by the fit itself: the score
    of a law with jumps is not to be had from a line.
    """
    fitted = [e for e in study.entries if e.effects and e.fit is not None]
    cost = {id(e): study.fitter.likelihood.cost(e.fit.prediction, e.fit.v) for e in fitted if e.fit}
    for e in sorted(fitted, key=lambda e: cost[id(e)])[:LEADERS]:
        simulate_folds(study, e)
    while todo := [e for e in leaders(study)[:LEADERS] if not e.simulated]:
        simulate_folds(study, todo[0])
