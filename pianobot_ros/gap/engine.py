"""`diagnose`: where the gap lies, which effect causes it, and how far it shrinks. The order of work
is the file's order.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from enum import Enum

import numpy as np

from pianobot_ros.gap.diagnosis import Diagnosis
from pianobot_ros.gap.explain.conclude import conclude
from pianobot_ros.gap.explain.experiment import propose_experiment
from pianobot_ros.gap.fitting.evidence import (
    Evidence,
    anything,
    implausible,
    material,
    prior_cost,
    told,
)
from pianobot_ros.gap.fitting.fit import Fit
from pianobot_ros.gap.posterior.hidden import likelier
from pianobot_ros.gap.posterior.judge import weigh
from pianobot_ros.gap.posterior.probabilities import posterior
from pianobot_ros.gap.problem.budget import BLOCKS, Budget
from pianobot_ros.gap.problem.constants import LEADERS
from pianobot_ros.gap.problem.errors import GapError
from pianobot_ros.gap.problem.options import Options
from pianobot_ros.gap.problem.types import Block, Twin
from pianobot_ros.gap.search.apart import what_sets_apart_is_no_scatter
from pianobot_ros.gap.search.contenders import leaders, open_further
from pianobot_ros.gap.search.grow import (
    fit_shortlist,
    grow,
    grow_beside_members,
    look_again,
    look_beside,
    look_from_all_starts,
    screen_library,
    screened,
)
from pianobot_ros.gap.search.opening import (
    never_vanishing,
    open_evidence,
    try_guesses,
    without_accidents,
)
from pianobot_ros.gap.search.parameters import fit_parameters, judge_at, lower_floor, rescore
from pianobot_ros.gap.search.settle import lead_converged, settle
from pianobot_ros.gap.search.study import Progress, Study


class Step(Enum):
    """What progress tells, one after the other."""

    REFITTING = "refitting parameters"
    SCREENING = "screening effects"
    FITTING = "fitting effects"
    FURTHER = "looking for a further effect"
    AGAIN = "looking again from the nominal parameters"
    ALL = "fitting all leaders until they converge"
    WEIGHING = "weighing the hypotheses"


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
    _say(progress, Step.WEIGHING, study)
    return _with_experiment(twin, conclude(posterior(study)), experiments)


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
    evidence = open_evidence(twin, blocks, seed, budget, jobs, options or Options())
    said = never_vanishing(evidence)
    study = _searched(evidence, progress)
    regular = without_accidents(evidence, study)
    if regular is not evidence:
        budget.renew()
        study = _searched(regular, progress)
    return told(study, *said)


def _searched(evidence: Evidence, progress: Progress | None) -> Study:
    """Whatever may explain the gap in what is judged."""
    _say(progress, Step.REFITTING)
    study = fit_parameters(evidence)
    repeat = any(noise.repeats for noise in study.fitter.noise.estimates.noises.values())
    if not (repeat or anything(study)):
        return study
    _say(progress, Step.SCREENING, study)
    study = screen_library(study)
    under = what_sets_apart_is_no_scatter(study)
    study = study if under is study else screen_library(under)
    refit = study.entry("parameters")
    if not anything(study):
        return study
    left = material(study, refit.held_out)
    if left or _odd(study, refit.fit) or likelier(study, refit, study.screened):
        study = _fit_effects(study, refit.fit, progress)
    return study


def _with_experiment(twin: Twin, diagnosis: Diagnosis, experiments: Sequence[Block]) -> Diagnosis:
    if not experiments:
        return diagnosis
    try:
        proposals = propose_experiment(twin, diagnosis, experiments)
    except GapError as error:  # what is known stays so
        said = f"no experiment is proposed: {error}"
        return replace(diagnosis, warnings=(*diagnosis.warnings, said))
    if not proposals:
        return diagnosis
    typical = float(np.median([p.gain for p in proposals]))
    return replace(diagnosis, next_experiment=proposals[0].to_json(typical))


def _fit_effects(study: Study, base: Fit, progress: Progress | None) -> Study:
    """Put effects on the table, singly and in pairs, until none is likely to be missing."""
    study = try_guesses(study)

    def tell(doing: str, share: float) -> None:
        _say(progress, Step.FITTING, study, doing, share)

    study = fit_shortlist(study, base, study.screened, study.options.shortlist, tell)
    _say(progress, Step.FURTHER, study)
    if leaders(study):
        study = _grown(look_beside(lead_converged(study)))
    _say(progress, Step.AGAIN, study)
    found, study = len(study.entries), look_again(study)
    if len(study.entries) > found:
        study = _grown(study)
    if not leaders(study):
        return study
    study = _look_behind(grow_beside_members(study))
    from_all = look_from_all_starts(study)
    study = grow(from_all) if from_all.entries is not study.entries else from_all
    _say(progress, Step.ALL, study)
    return rescore(settle(study))


def _grown(study: Study) -> Study:
    """The study with the leader fitted to its end and further effects beside it, under the floor
    that it leaves. Of several effects the rivals of the first need no fit to their end: what holds
    them all outdoes them.
    """
    study = lead_converged(lower_floor(lead_converged(study)))
    study = judge_at(study, leaders(study)[0])
    for _ in range(study.options.max_effects - 1):
        study = lead_converged(grow(study))
    return study


def _look_behind(study: Study) -> Study:
    """Where the leading effect leaves nothing open for which a further one would be looked for, fit
    what is likelier to hide beside it than not; whatever there is where its parameters are
    implausible, as behind refitted ones.
    """
    lead = leaders(study)[0]
    if len(lead.effects) >= study.options.max_effects or open_further(study, lead.held_out):
        return study
    found = screened(study, lead.fit, study.signatures)
    beside = [s for s in found if s.effect not in lead.effects]
    if not _odd(study, lead.fit):
        beside = likelier(study, lead, beside)
    return fit_shortlist(study, lead.fit, beside, LEADERS)


def _odd(study: Study, fit: Fit) -> bool:
    """Whether the parameters of a fit are implausible, whatever shape its effects have."""
    return prior_cost(fit, slice(len(study.problem.parameters))) > implausible(study)


def _say(
    progress: Progress | None,
    step: Step,
    study: Study | None = None,
    doing: str = "",
    share: float = 0.0,
) -> None:
    """Tell who asked which of the steps is under way, or what it is ``doing`` of which ``share`` is
    done; how far that is of all steps (0 to 1); and the leading effects with the weight that they
    have on the table so far.
    """
    if progress is None:
        return
    mass: dict[str, float] = defaultdict(float)
    if study is not None:
        for entry, weight in zip(study.entries, weigh(study).tolist(), strict=True):
            for name in entry.effects or (entry.name,):
                mass[name] += weight
    foremost = sorted(mass.items(), key=lambda item: -item[1])[:LEADERS]
    progress(doing or step.value, (list(Step).index(step) + share) / len(Step), tuple(foremost))
