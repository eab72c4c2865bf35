"""`diagnose`: where the gap lies, which effect causes it, and how far it shrinks. The order of work
is the file's order.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from pianobot_ros.gap.diagnosis import Diagnosis
from pianobot_ros.gap.explain.conclude import conclude
from pianobot_ros.gap.explain.experiment import propose_experiment
from pianobot_ros.gap.explain.progress import say
from pianobot_ros.gap.fitting.fit import Fit, Fitter
from pianobot_ros.gap.fitting.score import cross_validate, fixed, folds_of
from pianobot_ros.gap.floor.drift import Drift, find_drift
from pianobot_ros.gap.floor.measure import Gauge
from pianobot_ros.gap.floor.noise import NoiseModel
from pianobot_ros.gap.floor.splice import inherited
from pianobot_ros.gap.problem.budget import BLOCKS, Budget
from pianobot_ros.gap.problem.errors import GapError, SimulationFailed
from pianobot_ros.gap.problem.intake import blocks_that
from pianobot_ros.gap.problem.options import Options
from pianobot_ros.gap.problem.problem import Problem
from pianobot_ros.gap.problem.types import Array, Block, Twin
from pianobot_ros.gap.search.guesses import try_guesses
from pianobot_ros.gap.search.screening import (
    LEAST_RELIEF,
    Screened,
    Signature,
    begin,
    relief,
    screen,
    shortlist,
    signatures,
    squared_gaps,
)
from pianobot_ros.gap.search.study import (
    Entry,
    Progress,
    Study,
    anything,
    believed,
    gaps,
    make_entry,
    material,
    open_observables,
    pooled,
    prior_cost,
    simulate_folds,
    standing,
    temperatures,
)

CONVERGED_LEADERS = 3
"""So many leading hypotheses are fitted until they converge."""
RIVAL_SHARE = 0.5
"""A hypothesis that gains this share of what the best one gains is its rival: a further effect is
looked for beside it too, and its fit is tried from other places."""
LOWER = 0.7
"""Share of its floor under which an observable's scatter must fall before the leader is believed to
have explained it.
"""
FURTHER = 6
"""Further effects that are simulated on top of a leader."""
AGAIN = 3
"""Effects that are fitted from the nominal parameters where those fitted before leave much."""
HEAT = 3
"""Steps after which the shortlisted effects are compared first."""
NEIGHBOURS = (-1.0, 1.0)
"""Where else a shortlisted effect's further parameters are tried then, in prior standard
deviations."""
CALLS_OF_A_FIT = 40
"""Predictions that a fit takes."""
CONVERGE_SHARE = 0.3
"""Share of the best one's gain below which a hypothesis is not fitted until it converges."""
SHARES = (1.0, 0.3, 0.1)
"""Of an effect's size, from which it is fitted anew where refitting alone has become better."""
REFIT_SHARE, FIT_SHARE = 0.8, 0.1
"""Where the best leaves nothing open: shares of its gain below which a rival is not fitted again
from the best's values, and (by the linearised gain) not fitted at all.
"""


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
    study = _open(twin, blocks, seed, budget, jobs, options or Options())
    study.progress = progress
    say(study, "refitting parameters", 0.0)
    base = _fit_parameters(study)
    if not anything(study):
        return study
    say(study, "screening effects", 0.2)
    names = list(study.options.only or study.problem.effects)
    study.signatures = signatures(study.problem, base, _starts(study, names))
    study.screened = _screened(study, base, study.signatures)
    implausible = prior_cost(base) > study.options.calibration.implausible
    if implausible or material(study, study.entry("parameters").held_out):
        _fit_effects(study, base, names)
    return study


def _starts(study: Study, names: Iterable[str]) -> list[tuple[str, Mapping[str, float]]]:
    """All starts of effects."""
    return [(n, start) for n in names for start in study.problem.effects[n].starts]


def _with_experiment(twin: Twin, diagnosis: Diagnosis, experiments: Sequence[Block]) -> Diagnosis:
    if not experiments:
        return diagnosis
    proposals = propose_experiment(twin, diagnosis, experiments)
    if not proposals:
        return diagnosis
    typical = float(np.median([p.gain for p in proposals]))
    return replace(diagnosis, next_experiment=proposals[0].to_json(typical))


def _open(
    twin: Twin, blocks: Sequence[Block], seed: int, budget: Budget, jobs: int, options: Options
) -> Study:
    problem = _problem(twin, blocks, budget, jobs, options)
    unknown = [n for n in options.only if n not in problem.effects]
    if unknown:
        raise GapError(
            f"options.only names unknown effects {unknown}; the twin has"
            f" {', '.join(sorted(problem.effects))}"
        )
    problem.recentre(problem.nominal())
    nominal = problem.predict(problem.nominal(), ())
    noise = _noise(problem, problem.y - nominal, options)
    noise.inherited = inherited(problem, noise.floor, problem.nominal())
    noise = noise.rebuilt()
    study = Study(
        problem,
        options,
        seed,
        Fitter(problem, noise),
        Gauge(problem, noise),
        folds_of(problem, options.folds, seed),
        nominal,
    )
    study.warnings += problem.warnings
    return study


def _problem(
    twin: Twin, blocks: Sequence[Block], budget: Budget, jobs: int, options: Options
) -> Problem:
    """The problem of the blocks that the twin can simulate."""

    def made(some: Sequence[Block]) -> Problem:
        return Problem(
            twin,
            some,
            min_units=options.min_units,
            jobs=jobs,
            backend=options.backend,
            max_samples=options.max_samples,
            budget=budget,
        )

    try:
        return made(blocks)
    except SimulationFailed:
        nominal = {p.name: p.nominal for p in twin.parameters}
        kept, said = blocks_that(lambda b: twin.simulate([b], nominal, ()), blocks)
        problem = made(kept)
        problem.warnings.append(said)
        return problem


# -- fitting
# ---------------------------------------------------------------------------------


def _fit_parameters(study: Study) -> Fit:
    """Refit the nuisances alone; take the floor from the better residual; put "none" and
    "parameters" on the table.
    """
    problem, fitter = study.problem, study.fitter
    fitter.likelihood.set_efficiency(study.nominal)
    fit = fitter.start((), np.zeros(len(problem.parameters)))
    # for the floor only: as far as it goes without new derivatives
    fit = fitter.refine(fit, study.options.max_iterations, [])
    if problem.recentre(fit.values):
        fit = replace(fit, prediction=problem.predict(fit.values, ()))
    residual = problem.y - fit.prediction
    drift = find_drift(problem, residual, fit.jacobian)
    noise = _noise(problem, residual if drift is None else residual - drift.residual, study.options)
    for o, old in fitter.noise.noises.items():
        if old.floor < noise.noises[o].floor:
            noise.noises[o] = old
    noise.inherited = inherited(problem, noise.rebuilt().floor, fit.values)
    _judge_by(study, noise, fit.prediction)
    fit = study.fitter.refine(fit, study.options.max_iterations)
    _tell(study, noise, drift)
    _put_parameters(study, fit)
    return fit


def _noise(problem: Problem, residual: Array, options: Options) -> NoiseModel:
    """The floor by a residual (size,); lone strays of events are left out from now on."""
    noise = NoiseModel(problem, residual, options)
    if not noise.lone:
        return noise
    problem.leave_out(noise.lone)
    return NoiseModel(problem, residual, options)


def _judge_by(study: Study, noise: NoiseModel, prediction: Array) -> None:
    """Fit and measure under another floor from now on, as efficient as at `prediction`."""
    noise = noise.rebuilt()
    study.fitter, study.gauge = Fitter(study.problem, noise), Gauge(study.problem, noise)
    study.fitter.likelihood.set_efficiency(prediction)


def _tell(study: Study, noise: NoiseModel, drift: Drift | None) -> None:
    """What is to be known about the floor."""
    for text in study.problem.warnings:
        study.warn(text)
    if drift is not None:
        study.warn(
            f"repeats differ as if {drift.parameter} drifted over the session: it counts as gap,"
            " not as scatter"
        )
    for names, said in (
        (
            noise.estimated,
            "no repeats of a condition for {}: the floor was estimated from high-frequency"
            " residual, so it may be too low",
        ),
        (
            noise.humming,
            "a disturbance steady in session time differs between repeats of {}: it counts as gap,"
            " not as scatter",
        ),
        (
            noise.erratic,
            "a few repeats are far from the others in {}: they count as gap, not as scatter",
        ),
        (
            noise.drifting,
            "repeats drift over the session in {}: the floor is from consecutive ones",
        ),
    ):
        if names:
            study.warn(said.format(", ".join(names)))


def _put_parameters(study: Study, fit: Fit) -> None:
    fitter = study.fitter
    none = fixed(fitter, study.nominal, "none")
    study.entries = [e for e in study.entries if e.effects]
    study.entries.insert(
        0, Entry("none", (), none, None, study.nominal, pooled(study, study.nominal))
    )
    refit = make_entry(study, fit)
    simulate_folds(study, refit)
    study.entries.insert(1, refit)


def _fit_effects(study: Study, base: Fit, names: list[str]) -> None:
    options = study.options
    try_guesses(study, names, CALLS_OF_A_FIT)
    _refine_shortlist(study, base, study.screened, options.shortlist)
    say(study, "looking again from the nominal parameters", 0.5)
    _look_again(study, names)
    if len(study.entries) <= 2:
        return
    say(study, "fitting the leaders until they converge", 0.6)
    _settle(study, CONVERGED_LEADERS)
    _lower_floor(study)
    leader = _leaders(study)[0]
    study.fitter.likelihood.set_efficiency(leader.fit.prediction if leader.fit else study.nominal)
    _rescore(study)
    say(study, "looking for a further effect", 0.7)
    for _ in range(options.max_effects - 1):
        first, *rest = _leaders(study)[:2]
        done = True
        for leader in (
            first,
            *(e for e in rest if _gain(study, e) > RIVAL_SHARE * _gain(study, first)),
        ):
            if leader.fit is None or len(leader.effects) >= options.max_effects:
                continue
            if not _open_further(study, leader.held_out):
                continue
            others = [n for n in names if n not in leader.effects]
            if not others or not study.problem.allows(2 * CALLS_OF_A_FIT):
                study.warn("the budget did not allow looking for a further effect")
                continue
            more = _screen_on(study, leader.fit, others)
            _refine_shortlist(study, leader.fit, more, 3)
            done = False
        if done:
            break
    say(study, "trying simpler explanations", 0.85)
    _simplify(study)
    _settle(study, CONVERGED_LEADERS)
    _reconsider_parents(study)
    _rescore(study)
    _verify(study)


def _verify(study: Study) -> None:
    """Simulate the folds of the hypotheses that may lead by score, or by the fit itself: the score
    of a law with jumps is not to be had from a line.
    """
    fitted = [e for e in study.entries if e.effects and e.fit is not None]
    cost = {id(e): study.fitter.likelihood.cost(e.fit.prediction, e.fit.v) for e in fitted if e.fit}
    for e in sorted(fitted, key=lambda e: cost[id(e)])[:CONVERGED_LEADERS]:
        simulate_folds(study, e)
    while todo := [e for e in _leaders(study)[:CONVERGED_LEADERS] if not e.simulated]:
        simulate_folds(study, todo[0])


def _look_again(study: Study, names: list[str]) -> None:
    """Screen once more from the nominal parameters where no effect leaves little of the gap.

    Refitted parameters may have gone far to make up for a missing effect. From there its trace is
    not seen; from where they belong it is.
    """
    entries = [study.entry("parameters"), *_leaders(study)]
    best = min(entries, key=lambda e: _left(study, e))
    if not _leaves_much(study, best) or not _open_further(study, best.held_out):
        return
    best_start = {s.effect: s.start for s in study.screened}
    trials = [t for t in _starts(study, names) if best_start.get(t[0], t[1]) == t[1]]
    cost = len(study.problem.parameters) + len(trials)
    if not study.problem.allows(cost + AGAIN * CALLS_OF_A_FIT):
        study.warn("the budget did not allow looking again from the nominal parameters")
        return
    fitter = study.fitter
    base = fitter.start((), np.zeros(len(study.problem.parameters)))
    tried = {e.effects[0] for e in study.entries if len(e.effects) == 1}
    known = signatures(study.problem, base, [t for t in trials if t[0] not in tried])
    _race(study, base, _screened(study, base, known)[:AGAIN])


def _screen_on(study: Study, base: Fit, names: list[str]) -> list[Screened]:
    """The foremost of the effects `names` on top of a fit that has effects already: chosen by their
    signatures on the refitted parameters, screened by those on this fit.
    """
    known = [s for s in study.signatures if s.effect in names]
    found = _screened(study, base, known)
    chosen = shortlist(found, FURTHER, open_observables(study, base.prediction))
    own = signatures(study.problem, base, _starts(study, [s.effect for s in chosen]))
    return _screened(study, base, own)


def _relieves(study: Study, before: Array, after: Array) -> bool:
    """Whether a prediction relieves any observable that another leaves open: what gains only within
    the floor is never named, so it need not be looked at any closer. So it does where none is open.
    """
    wide = open_observables(study, before)
    gone = relief(*(squared_gaps(study.gauge, x) for x in (before, after)))
    return not wide or bool(np.any(gone[wide] > LEAST_RELIEF))


def _screened(study: Study, base: Fit, known: Iterable[Signature]) -> list[Screened]:
    """The effects of the signatures `known` on top of a fit, best first."""
    return screen(study.fitter, base, known, study.ways, study.gauge, temperatures(study))


def _lower_floor(study: Study) -> None:
    """Take the floor from the leader's residual where repeats scatter far less under it: what it
    explains was no scatter.

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
    found.inherited = old.inherited
    _judge_by(study, found, leader.fit.prediction)
    study.warn(
        f"repeats of {', '.join(study.problem.observables[o].name for o in lower)} differ by what"
        f" {leader.name} explains: it counts as gap, not as scatter"
    )
    _rescore(study)
    for e in study.entries:
        e.gap, e.settled = pooled(study, e.held_out), False
    _settle(study, CONVERGED_LEADERS)


def _leaders(study: Study) -> list[Entry]:
    """Hypotheses with effects, best held-out score first."""
    return sorted((e for e in study.entries if e.effects), key=lambda e: -standing(study, e))


def _open_further(study: Study, prediction: Array) -> bool:
    """Whether a prediction leaves enough open that a further effect, or a better fit, is worth
    looking for.
    """
    return bool(open_observables(study, prediction, study.options.calibration.further, sigma=0.0))


def _out_of_reach(study: Study, gain: float, share: float) -> bool:
    """Whether a hypothesis need not be looked at any closer: the best one leaves nothing open, and
    gains far more.
    """
    leaders = _leaders(study)
    return (
        bool(leaders)
        and not _open_further(study, leaders[0].held_out)
        and gain < share * _gain(study, leaders[0])
    )


def _gain(study: Study, e: Entry) -> float:
    """Held-out score gained over refitting alone, in nats that count."""
    return standing(study, e) - standing(study, study.entry("parameters"))


def _settle(study: Study, count: int) -> None:
    """Fit the leaders until they converge: those that are compared in the end must not differ by
    where they stopped.
    """
    for _ in range(2):  # a settled fit may change who leads
        for e in [e for e in _leaders(study)[:count] if not e.settled and e.fit is not None]:
            if _gain(study, e) < CONVERGE_SHARE * _gain(study, _leaders(study)[0]):
                continue
            if not _relieves(study, study.entry("parameters").held_out, e.held_out):
                continue
            if not study.problem.allows(CALLS_OF_A_FIT):
                study.warn(
                    "the budget did not allow fitting the leading hypotheses until they converge"
                )
                return
            assert e.fit is not None
            fit = study.fitter.refine(e.fit, study.options.max_iterations)
            if _gain(study, e) > RIVAL_SHARE * _gain(study, _leaders(study)[0]) and _open_further(
                study, fit.prediction
            ):
                own = range(len(study.problem.parameters), len(fit.space))
                fit = study.fitter.hop(fit, list(own), study.options.triage_iterations)
            study.replace(e, make_entry(study, fit, settled=True))
    _share_values(study, count)


def _left(study: Study, e: Entry) -> float:
    """Squared gap above the floor's square, over all observables, that a hypothesis leaves."""
    return float(np.maximum(gaps(study, e) ** 2 - 1.0, 0.0).sum())


def _leaves_much(study: Study, e: Entry) -> bool:
    """Whether a hypothesis leaves so much of what refitting leaves that *unknown* is likelier."""
    whole = _left(study, study.entry("parameters"))
    return not e.effects or _left(study, e) > study.options.calibration.imprecision * whole


def _share_values(study: Study, count: int) -> None:
    """Try the best hypothesis' parameters of the robot in the others, once: valleys are long, and
    each fit may stop elsewhere.

    Rivals are fitted again from there, unless the best leaves so much that it matters little which
    of them is nearest; any other only where they lower its cost as they are. Parameters alone come
    first: an effect that then costs more than they do has them as a special case, so its fit is not
    at its end, however little it has gained so far.
    """
    best, *rest = _leaders(study)
    if best.fit is None:
        return
    close = not _leaves_much(study, best)
    shared = len(study.problem.parameters)
    for e in [study.entry("parameters"), *rest]:
        if e.fit is None:
            continue
        if len(e.effects) == 1 and _above_parent(study, e):
            _try_from(study, e, _near_parent(study, e))
            continue
        if e.effects and _gain(study, e) < CONVERGE_SHARE * _gain(study, best):
            continue
        v = np.concatenate([best.fit.v[:shared], e.fit.v[shared:]])
        rival = (
            close and e in rest[: count - 1] and _gain(study, e) >= RIVAL_SHARE * _gain(study, best)
        )
        if (rival and not _out_of_reach(study, _gain(study, e), REFIT_SHARE)) or _is_lower(
            study, e.fit, v
        ):
            _try_from(study, e, v)


def _is_lower(study: Study, fit: Fit, v: Array) -> bool:
    """Whether the parameters `v` cost less than those of a fit, as costs are counted now."""
    return study.fitter.likelihood.cost_at(
        fit.effects, fit.space, v
    ) < study.fitter.likelihood.cost(fit.prediction, fit.v)


def _above_parent(study: Study, e: Entry) -> bool:
    """Whether a hypothesis fits worse than refitting alone, of which it is a generalisation."""
    parent, cost = study.entry("parameters").fit, study.fitter.likelihood.cost
    if parent is None or e.fit is None:
        return False
    return cost(e.fit.prediction, e.fit.v) > cost(parent.prediction, parent.v)


def _near_parent(study: Study, e: Entry) -> Array:
    """Values of refitting alone, with that share of one effect's size which costs least: with none
    of it the costs are equal.
    """
    parent, (name,) = study.entry("parameters").fit, e.effects
    assert parent is not None and e.fit is not None
    effect, space, values = study.problem.effects[name], e.fit.space, e.fit.values
    found = {p.name: values[p.name] for p in effect.parameters}
    size = found[effect.magnitude] - effect.null
    starts = [
        space.encode(parent.values | found | {effect.magnitude: effect.null + share * size})
        for share in SHARES
    ]
    return min(starts, key=lambda v: study.fitter.likelihood.cost_at(e.effects, space, v))


def _reconsider_parents(study: Study) -> None:
    """Fit the members of the best pair alone again, from the pair's values: a pair may only have
    found the better optimum.
    """
    best = _leaders(study)[0]
    if len(best.effects) < 2 or best.fit is None:
        return
    alone = {e.effects[0]: e for e in study.entries if len(e.effects) == 1}
    for name in best.effects:
        space = study.fitter.space((name,))
        v = space.encode({n: best.fit.values[n] for n in space.names})
        if name in alone:
            _try_from(study, alone[name], v)
        elif study.problem.allows(CALLS_OF_A_FIT):  # the shortlist had left it out
            fit = study.fitter.refine(study.fitter.start((name,), v), study.options.max_iterations)
            study.entries.append(make_entry(study, fit, settled=True))


def _try_from(study: Study, e: Entry, v: Array) -> None:
    """Fit a hypothesis again from `v`; it takes the old one's place if it ends lower (as costs are
    counted now).
    """
    if e.fit is None or not study.problem.allows(CALLS_OF_A_FIT):
        return
    fit = study.fitter.refine(
        study.fitter.start(e.effects, v, e.fit.jacobian), study.options.max_iterations
    )
    if fit.cost < study.fitter.likelihood.cost(e.fit.prediction, e.fit.v):
        study.replace(e, make_entry(study, fit, settled=True))


def _simplify(study: Study) -> None:
    """Try simpler relatives of the members of the best pair: forward selection starts from whatever
    single looked best.
    """
    pairs = [e for e in study.entries if len(e.effects) == 2]
    if not pairs:
        return
    best = max(pairs, key=lambda e: standing(study, e))
    size = {n: len(x.parameters) for n, x in study.problem.effects.items()}
    single = {e.effects[0]: e for e in study.entries if len(e.effects) == 1}
    for member in best.effects:
        (other,) = (n for n in best.effects if n != member)
        if member not in single:
            continue
        reached = _gain(study, single[member])
        for name, e in single.items():
            relative = (
                name not in best.effects
                and size[name] < size[member]
                and _gain(study, e) > 0.8 * reached > 0
            )
            if relative and e.fit is not None and study.problem.allows(CALLS_OF_A_FIT):
                own = signatures(study.problem, e.fit, _starts(study, [other]))
                more = _screened(study, e.fit, own)
                _refine_shortlist(study, e.fit, more, 1)


def _refine_shortlist(study: Study, base: Fit, screened: list[Screened], count: int) -> None:
    known = {frozenset(e.effects) for e in study.entries if e.effects}
    chosen = [
        s
        for s in shortlist(screened, count, open_observables(study, base.prediction))
        if frozenset((*base.effects, s.effect)) not in known
        and not _out_of_reach(study, s.gain, FIT_SHARE)
    ]
    _race(study, base, chosen)


def _columns(base: Fit, fit: Fit) -> list[int]:
    """Columns of the parameters that a fit has beyond those of `base`, an effect's size first."""
    return list(range(len(base.space), len(fit.space)))


def _race(study: Study, base: Fit, chosen: list[Screened]) -> None:
    """Fit effects on top of `base`: a few steps each, and more only for those that do not fall far
    behind (racing; Maron and Moore 1994).
    """
    fitter, options = study.fitter, study.options
    temperature = temperatures(study)
    costs = fitter.likelihood.costs_of(base.prediction)

    def gained(fit: Fit) -> float:
        return float(((costs - fitter.likelihood.costs_of(fit.prediction)) / temperature).sum())

    fits: list[Fit] = []
    hopeful: list[bool] = []
    wide = open_observables(study, base.prediction)
    enough = 0.0
    for k, candidate in enumerate(chosen):
        # a line may predict left-out conditions badly where the whole law does not: what relieves
        # an open observable is fitted as long as nothing else explains it
        if candidate.gain < FIT_SHARE * enough and (enough or not candidate.relieves(wide)):
            continue
        if len(study.entries) == 2:  # the first shortlist, of single effects
            say(study, f"fitting {candidate.effect}", 0.3 + 0.2 * k / len(chosen))
        if k and not study.problem.allows(10.0 + 3 * HEAT):
            study.warn(f"the budget allowed {k} of {len(chosen)} shortlisted effects")
            break
        fit = begin(fitter, base, candidate)
        if fit is None:
            continue
        columns = _columns(base, fit)
        further = columns[1:]
        fit = fitter.refine(fit, HEAT, columns)
        relieves = candidate.relieves(wide) or _relieves(study, base.prediction, fit.prediction)
        if relieves and further and _open_further(study, fit.prediction):
            # a law of several parameters has several valleys, and its starts differ in few of them
            fit = fitter.hop(fit, further, HEAT, rounds=1, far=NEIGHBOURS)
        fits.append(fit)
        hopeful.append(relieves)
        if not _open_further(study, fit.prediction):
            enough = max(enough, gained(fit))
    most = max((gained(f) for f in fits), default=0.0)
    left = options.triage_iterations - HEAT
    for k, fit in enumerate(fits):
        if hopeful[k] and gained(fit) >= CONVERGE_SHARE * most and study.problem.allows(3 * left):
            fits[k] = fitter.refine(fit, left, _columns(base, fit))
    study.entries += [make_entry(study, fit) for fit in fits]


def _rescore(study: Study) -> None:
    """Score everything again under the current efficiencies, so that all are compared alike."""
    for e in study.entries:
        if e.fit is None:
            e.scored = fixed(study.fitter, study.nominal, "none")
        else:
            e.scored = believed(study, cross_validate(study.fitter, e.fit, study.ways), e.held_out)
