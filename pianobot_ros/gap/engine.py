"""`diagnose`: where the gap lies, which effect causes it, and how far it shrinks. The order of work is the file's order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pianobot_ros.gap.conclude import conclude
from pianobot_ros.gap.diagnosis import Diagnosis
from pianobot_ros.gap.drift import Drift, find_drift
from pianobot_ros.gap.errors import GapError
from pianobot_ros.gap.experiment import propose_experiment
from pianobot_ros.gap.fit import Fit, Fitter
from pianobot_ros.gap.measure import Gauge
from pianobot_ros.gap.noise import NoiseModel
from pianobot_ros.gap.options import Options
from pianobot_ros.gap.problem import Problem
from pianobot_ros.gap.score import cross_validate, fixed, folds_of
from pianobot_ros.gap.search import Clock, Screened, refine, screen, shortlist, within_budget
from pianobot_ros.gap.study import Entry, Study, believed, make_entry, material, open_observables, pooled, prior_cost
from pianobot_ros.gap.types import Array, Block, Twin

SETTLED = 4
"""So many leading hypotheses are fitted until they converge."""
RIVAL = 0.5
"""A hypothesis that gains this share of what the best one gains is its rival: a further effect is looked for beside it too, and
its fit is tried from other places."""
LOWER = 0.7
"""Share of its floor under which an observable's scatter must fall before the leader is believed to have explained it."""
NEAR, BEHIND, HOPELESS = 0.8, 0.3, 0.1
"""Where the best leaves nothing open: shares of its gain below which a rival is not fitted again from the best's values, not
fitted until it converges, and (by the linearised gain) not fitted at all."""


def diagnose(twin: Twin, blocks: Sequence[Block], *, seed: int = 0, budget: float = 60.0, jobs: int = 1,
             options: Options | None = None, experiments: Sequence[Block] = ()) -> Diagnosis:  # fmt: skip
    """Diagnose the gap between `blocks` as measured and `twin`.

    `experiments` are blocks that could be recorded next (inputs as they would be; outputs give the time stamps): the one that
    best separates the leading hypotheses becomes `next_experiment`.

    `budget` is in wall seconds and is honoured by refining fewer effects; `jobs` processes call the twin in parallel;
    everything random derives from `seed`. Raises GapError when twin and blocks do not fit together.
    """
    study = _open(twin, blocks, seed, budget, jobs, options or Options())
    _investigate(study)
    return _with_experiment(twin, conclude(study), experiments)


def _investigate(study: Study) -> None:
    """Put on the table whatever may explain the gap."""
    base = _fit_parameters(study)
    if not material(study, study.nominal):
        return
    names = list(study.options.only or study.problem.effects)
    study.screened = screen(study.fitter, base, names, study.ways)
    implausible = prior_cost(base) > study.options.calibration.implausible
    if implausible or material(study, study.entry("parameters").held_out):
        _fit_effects(study, base, names)


def _with_experiment(twin: Twin, diagnosis: Diagnosis, experiments: Sequence[Block]) -> Diagnosis:
    if not experiments:
        return diagnosis
    proposals = propose_experiment(twin, diagnosis, experiments)
    if not proposals:
        return diagnosis
    typical = float(np.median([p.gain for p in proposals]))
    return replace(diagnosis, next_experiment=proposals[0].to_json(typical))


def _open(twin: Twin, blocks: Sequence[Block], seed: int, budget: float, jobs: int, options: Options) -> Study:
    clock = Clock(budget)
    problem = Problem(
        twin, blocks, min_units=options.min_units, jobs=jobs, backend=options.backend, max_samples=options.max_samples
    )
    unknown = [n for n in options.only if n not in problem.effects]
    if unknown:
        raise GapError(
            f"options.only names unknown effects {unknown}; the twin has {', '.join(sorted(problem.effects))}"
        )
    problem.recentre(problem.nominal())
    nominal = problem.predict(problem.nominal(), ())
    noise = NoiseModel(problem, problem.y - nominal, options)
    study = Study(problem, options, clock, seed, Fitter(problem, noise), Gauge(problem, noise),
                  folds_of(problem, options.folds, seed), nominal)  # fmt: skip
    study.warnings += problem.warnings
    return study


# -- fitting ------------------------------------------------------------------------------------------------------------


def _fit_parameters(study: Study) -> Fit:
    """Refit the nuisances alone; take the floor from the better residual; put "none" and "parameters" on the table."""
    problem, fitter = study.problem, study.fitter
    fitter.set_efficiency(study.nominal)
    fit = fitter.start((), np.zeros(len(problem.parameters)))
    fit = fitter.refine(fit, study.options.max_iterations)
    if problem.recentre(fit.values):
        fit = replace(fit, prediction=problem.predict(fit.values, ()))
    residual = problem.y - fit.prediction
    drift = find_drift(problem, residual, fit.jacobian)
    noise = NoiseModel(problem, residual if drift is None else residual - drift.residual, study.options)
    for o, old in fitter.noise.noises.items():
        if old.floor < noise.noises[o].floor:
            noise.noises[o] = old
    _judge_by(study, noise, fit.prediction)
    fit = study.fitter.refine(fit, study.options.max_iterations)
    _tell(study, noise, drift)
    _put_parameters(study, fit)
    return fit


def _judge_by(study: Study, noise: NoiseModel, prediction: Array) -> None:
    """Fit and measure under another floor from now on, as efficient as at `prediction`."""
    noise = noise.rebuilt()
    study.fitter, study.gauge = Fitter(study.problem, noise), Gauge(study.problem, noise)
    study.fitter.set_efficiency(prediction)


def _tell(study: Study, noise: NoiseModel, drift: Drift | None) -> None:
    """What is to be known about the floor."""
    if drift is not None:
        study.warn(f"repeats differ as if {drift.parameter} drifted over the session: it counts as gap, not as scatter")
    if noise.estimated:
        study.warn("no repeats of a condition for " + ", ".join(noise.estimated) + ": the floor was estimated from "
                   "high-frequency residual, so it may be too low")  # fmt: skip
    if noise.humming:
        study.warn("a disturbance steady in session time differs between repeats of " + ", ".join(noise.humming)
                   + ": it counts as gap, not as scatter")  # fmt: skip
    if noise.erratic:
        study.warn("a few repeats are far from the others in " + ", ".join(noise.erratic)
                   + ": they count as gap, not as scatter")  # fmt: skip
    if noise.drifting:
        study.warn(
            "repeats drift over the session in " + ", ".join(noise.drifting) + ": the floor is from consecutive ones"
        )


def _put_parameters(study: Study, fit: Fit) -> None:
    fitter = study.fitter
    none = fixed(fitter, study.nominal, "none")
    study.entries = [e for e in study.entries if e.effects]
    study.entries.insert(0, Entry("none", (), none, None, study.nominal, pooled(study, study.nominal)))
    study.entries.insert(1, make_entry(study, fit))


def _fit_effects(study: Study, base: Fit, names: list[str]) -> None:
    problem, options = study.problem, study.options
    _refine_shortlist(study, base, study.screened, options.shortlist)
    if len(study.entries) <= 2:
        return
    _settle(study, SETTLED)
    _lower_floor(study)
    leader = _leaders(study)[0]
    study.fitter.set_efficiency(leader.fit.prediction if leader.fit else study.nominal)
    _rescore(study)
    for _ in range(options.max_effects - 1):
        first, *rest = _leaders(study)[:2]
        done = True
        for leader in (first, *(e for e in rest if _gain(study, e) > RIVAL * _gain(study, first))):
            if leader.fit is None or len(leader.effects) >= options.max_effects:
                continue
            if not _open_further(study, leader.held_out):
                continue
            others = [n for n in names if n not in leader.effects]
            cost = sum(len(problem.effects[n].starts) for n in others) + 40
            if not others or not within_budget(study.clock, study.seconds_per_call, cost):
                study.warn("the budget did not allow looking for a further effect")
                continue
            more = screen(study.fitter, leader.fit, others, study.ways)
            _refine_shortlist(study, leader.fit, more, 3)
            done = False
        if done:
            break
    _simplify(study)
    _settle(study, SETTLED)
    _reconsider_parents(study)
    _rescore(study)


def _lower_floor(study: Study) -> None:
    """Take the floor from the leader's residual where repeats scatter far less under it: what it explains was no scatter.

    A clock that runs away moves every note from its repeats; a further effect would hide in that.
    """
    leader, old = _leaders(study)[0], study.fitter.noise
    if leader.fit is None or _gain(study, leader) <= 0:
        return
    found = NoiseModel(study.problem, study.problem.y - leader.fit.prediction, study.options)
    lower = [o for o, noise in found.noises.items() if noise.floor < LOWER * old.noises[o].floor]
    if not lower:
        return
    for o in set(found.noises) - set(lower):
        found.noises[o] = old.noises[o]
    _judge_by(study, found, leader.fit.prediction)
    study.warn(f"repeats of {', '.join(study.problem.observables[o].name for o in lower)} differ by what {leader.name} explains: "
               "it counts as gap, not as scatter")  # fmt: skip
    _rescore(study)
    for e in study.entries:
        e.gap, e.settled = pooled(study, e.held_out), False
    _settle(study, SETTLED)


def _leaders(study: Study) -> list[Entry]:
    """Hypotheses with effects, best held-out score first."""
    return sorted((e for e in study.entries if e.effects), key=lambda e: -e.score)


def _open_further(study: Study, prediction: Array) -> bool:
    """Whether a prediction leaves enough open that a further effect, or a better fit, is worth looking for."""
    return bool(open_observables(study, prediction, study.options.calibration.further, sigma=0.0))


def _out_of_reach(study: Study, gain: float, share: float) -> bool:
    """Whether a hypothesis need not be looked at any closer: the best one leaves nothing open, and gains far more."""
    leaders = _leaders(study)
    return bool(leaders) and not _open_further(study, leaders[0].held_out) and gain < share * _gain(study, leaders[0])


def _gain(study: Study, e: Entry) -> float:
    """Held-out score gained over refitting alone."""
    return e.score - study.entry("parameters").score


def _settle(study: Study, count: int) -> None:
    """Fit the leaders until they converge: those that are compared in the end must not differ by where they stopped."""
    for _ in range(2):  # a settled fit may change who leads
        for e in [e for e in _leaders(study)[:count] if not e.settled and e.fit is not None]:
            if _out_of_reach(study, _gain(study, e), BEHIND):
                continue
            if not within_budget(study.clock, study.seconds_per_call, 40):
                study.warn("the budget did not allow fitting the leading hypotheses until they converge")
                return
            assert e.fit is not None
            fit = study.fitter.refine(e.fit, study.options.max_iterations)
            if _gain(study, e) > RIVAL * _gain(study, _leaders(study)[0]) and _open_further(study, fit.prediction):
                own = range(len(study.problem.parameters), len(fit.space))
                fit = study.fitter.hop(fit, list(own), study.options.triage_iterations)
            study.replace(e, make_entry(study, fit, settled=True))
    _share_values(study, count)


def _share_values(study: Study, count: int) -> None:
    """Try the best hypothesis' parameters of the robot in the others, once: valleys are long, and each fit may stop elsewhere.

    Rivals are fitted again from there; any other only where they lower its cost as they are.
    """
    best, *rest = _leaders(study)
    if best.fit is None:
        return
    shared = len(study.problem.parameters)
    for e in [*rest, study.entry("parameters")]:
        if e.fit is None:
            continue
        v = np.concatenate([best.fit.v[:shared], e.fit.v[shared:]])
        rival = e in rest[: count - 1] and _gain(study, e) >= RIVAL * _gain(study, best)
        if (rival and not _out_of_reach(study, _gain(study, e), NEAR)) or _is_lower(study, e.fit, v):
            _try_from(study, e, v)


def _is_lower(study: Study, fit: Fit, v: Array) -> bool:
    """Whether the parameters `v` cost less than those of a fit, as costs are counted now."""
    return study.fitter.cost_at(fit.effects, fit.space, v) < study.fitter.cost(fit.prediction, fit.v)


def _reconsider_parents(study: Study) -> None:
    """Fit the members of the best pair alone again, from the pair's values: a pair may only have found the better optimum."""
    best = _leaders(study)[0]
    if len(best.effects) < 2 or best.fit is None:
        return
    alone = {e.effects[0]: e for e in study.entries if len(e.effects) == 1}
    for name in best.effects:
        space = study.fitter.space((name,))
        v = space.encode({n: best.fit.values[n] for n in space.names})
        if name in alone:
            _try_from(study, alone[name], v)
        elif within_budget(study.clock, study.seconds_per_call, 40):  # the shortlist had left it out
            fit = study.fitter.refine(study.fitter.start((name,), v), study.options.max_iterations)
            study.entries.append(make_entry(study, fit, settled=True))


def _try_from(study: Study, e: Entry, v: Array) -> None:
    """Fit a hypothesis again from `v`; it takes the old one's place if it ends lower (as costs are counted now)."""
    if e.fit is None or not within_budget(study.clock, study.seconds_per_call, 40):
        return
    fit = study.fitter.refine(study.fitter.start(e.effects, v, e.fit.jacobian), study.options.max_iterations)
    if fit.cost < study.fitter.cost(e.fit.prediction, e.fit.v):
        study.replace(e, make_entry(study, fit, settled=True))


def _simplify(study: Study) -> None:
    """Try simpler relatives of the members of the best pair: forward selection starts from whatever single looked best."""
    pairs = [e for e in study.entries if len(e.effects) == 2]
    if not pairs:
        return
    best = max(pairs, key=lambda e: e.score)
    size = {n: len(x.parameters) for n, x in study.problem.effects.items()}
    single = {e.effects[0]: e for e in study.entries if len(e.effects) == 1}
    for member in best.effects:
        (other,) = (n for n in best.effects if n != member)
        if member not in single:
            continue
        reached = _gain(study, single[member])
        for name, e in single.items():
            relative = name not in best.effects and size[name] < size[member] and _gain(study, e) > 0.8 * reached > 0
            if relative and e.fit is not None and within_budget(study.clock, study.seconds_per_call, 40):
                _refine_shortlist(study, e.fit, screen(study.fitter, e.fit, [other], study.ways), 1)


def _refine_shortlist(study: Study, base: Fit, screened: list[Screened], count: int) -> None:
    known = {frozenset(e.effects) for e in study.entries if e.effects}
    chosen = shortlist(screened, count, open_observables(study, base.prediction))
    for k, candidate in enumerate(chosen):
        if frozenset((*base.effects, candidate.effect)) in known:
            continue
        if _out_of_reach(study, candidate.gain, HOPELESS):
            continue
        calls = 10.0 + 3 * study.options.triage_iterations
        if k and not within_budget(study.clock, study.seconds_per_call, calls):
            study.warn(f"the budget allowed {k} of {len(chosen)} shortlisted effects")
            break
        fit = refine(study.fitter, base, candidate, study.options.triage_iterations)
        if fit is not None:
            study.entries.append(make_entry(study, fit))


def _rescore(study: Study) -> None:
    """Score everything again under the current efficiencies, so that all are compared alike."""
    for e in study.entries:
        if e.fit is None:
            e.scored = fixed(study.fitter, study.nominal, "none")
        else:
            e.scored = believed(study, cross_validate(study.fitter, e.fit, study.ways), e.held_out)
