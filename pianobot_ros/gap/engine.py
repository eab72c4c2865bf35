"""`diagnose`: where the gap lies, which effect causes it, and how far it shrinks. The order of work is the file's order."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pianobot_ros.gap.describe import describe
from pianobot_ros.gap.diagnosis import Candidate, Diagnosis, Estimate, FoundEffect, Hypothesis
from pianobot_ros.gap.errors import GapError
from pianobot_ros.gap.experiment import propose_experiment
from pianobot_ros.gap.fit import Fit, Fitter
from pianobot_ros.gap.measure import Gauge, assemble
from pianobot_ros.gap.noise import NoiseModel
from pianobot_ros.gap.options import Options
from pianobot_ros.gap.problem import Problem
from pianobot_ros.gap.score import Scored, cross_validate, difference, fixed, folds_of, weights
from pianobot_ros.gap.search import Clock, Screened, polish, refine, screen, within_budget
from pianobot_ros.gap.separability import groups
from pianobot_ros.gap.shares import stage_shares
from pianobot_ros.gap.traces import traces
from pianobot_ros.gap.types import Array, Block, Twin
from pianobot_ros.gap.verdict import credible_set, log_priors, unknown_probability
from pianobot_ros.gap.words import sentence


@dataclass
class Entry:
    """A hypothesis on the table."""

    name: str
    effects: tuple[str, ...]
    scored: Scored
    fit: Fit | None
    held_out: Array
    gap: float
    admissible: bool = True


@dataclass
class Study:
    """State of one diagnosis."""

    problem: Problem
    options: Options
    clock: Clock
    seed: int
    fitter: Fitter
    gauge: Gauge
    ways: list[Array]
    nominal: Array
    entries: list[Entry] = field(default_factory=list)
    screened: list[Screened] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def warn(self, text: str) -> None:
        """Remember a warning once."""
        if text not in self.warnings:
            self.warnings.append(text)

    def entry(self, name: str) -> Entry:
        """Entry by name."""
        return next(e for e in self.entries if e.name == name)

    @property
    def seconds_per_call(self) -> float:
        """Measured cost of one call of the twin."""
        return self.problem.sim_seconds / max(self.problem.calls, 1)


def diagnose(twin: Twin, blocks: Sequence[Block], *, seed: int = 0, budget: float = 60.0, jobs: int = 1,
             options: Options | None = None, experiments: Sequence[Block] = ()) -> Diagnosis:  # fmt: skip
    """Diagnose the gap between `blocks` as measured and `twin`.

    `experiments` are blocks that could be recorded next (inputs as they would be; outputs give the time stamps): the one that
    best separates the leading hypotheses becomes `next_experiment`.

    `budget` is in wall seconds and is honoured by refining fewer effects; `jobs` processes call the twin in parallel;
    everything random derives from `seed`. Raises GapError when twin and blocks do not fit together.
    """
    options = options or Options()
    study = _open(twin, blocks, seed, budget, jobs, options)
    base = _fit_parameters(study)
    if _material(study, study.nominal) and (
        _material(study, study.entry("parameters").held_out)
        or _prior_cost(base) > study.options.calibration.implausible
    ):
        _fit_effects(study, base)
    return _with_experiment(twin, _conclude(study), experiments)


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
    noise = NoiseModel(problem, problem.y - fit.prediction, study.options)
    for o, old in fitter.noise.noises.items():
        if old.floor < noise.noises[o].floor:
            noise.noises[o] = old
    noise = noise.rebuilt()
    study.fitter = fitter = Fitter(problem, noise)
    study.gauge = Gauge(problem, noise)
    fitter.set_efficiency(fit.prediction)
    fit = fitter.refine(replace(fit, cost=fitter.cost(fit.prediction, fit.v)), 3)
    if noise.estimated:
        study.warn("no repeats of a condition for " + ", ".join(noise.estimated) + ": the floor was estimated from "
                   "high-frequency residual, so it may be too low")  # fmt: skip
    if noise.drifting:
        study.warn(
            "repeats drift over the session in " + ", ".join(noise.drifting) + ": the floor is from consecutive ones"
        )
    _put_parameters(study, fit)
    return fit


def _put_parameters(study: Study, fit: Fit) -> None:
    fitter = study.fitter
    none = fixed(fitter, study.nominal, "none")
    study.entries = [e for e in study.entries if e.effects]
    study.entries.insert(0, Entry("none", (), none, None, study.nominal, _pooled(study, study.nominal)))
    study.entries.insert(1, _entry(study, fit))


def _entry(study: Study, fit: Fit) -> Entry:
    scored = cross_validate(study.fitter, fit, study.ways)
    way = study.ways[0]
    parts = [(np.flatnonzero(way == k), fit.space.decode(fit.space.clip(v))) for k, v in enumerate(scored.fold_v)]
    flat = assemble(study.problem, parts, fit.effects, study.warn)
    return Entry(fit.name, fit.effects, scored, fit, flat, _pooled(study, flat))


def _pooled(study: Study, prediction: Array) -> float:
    return study.gauge.pooled(study.gauge.squares(prediction))


def _material(study: Study, prediction: Array) -> bool:
    """Whether the systematic gap of any observable (or event) exceeds the material share of its floor."""
    each = study.gauge.per_observable(study.gauge.squares(prediction))
    worst = float(np.nanmax(each))
    return worst > float(np.hypot(1.0, study.options.calibration.material))


def _prior_cost(fit: Fit | None) -> float:
    """How far (nats) the prior had to be stretched. A missing effect is often absorbed by implausible parameters."""
    return 0.0 if fit is None else 0.5 * float(fit.v @ fit.v)


def _fit_effects(study: Study, base: Fit) -> None:
    problem, options = study.problem, study.options
    names = list(options.only or problem.effects)
    study.screened = screen(study.fitter, base, names, study.ways)
    _refine_shortlist(study, base, study.screened, options.shortlist)
    if len(study.entries) <= 2:
        return
    leaders = sorted((e for e in study.entries if e.effects), key=lambda e: -float(e.scored.per_unit.sum()))[:2]
    for k, leader in enumerate(leaders):
        if leader.fit is not None and within_budget(study.clock, study.seconds_per_call, 4 * len(leader.fit.space)):
            fit = polish(study.fitter, leader.fit)
            study.entries[study.entries.index(leader)] = leaders[k] = _entry(study, fit)
    study.fitter.set_efficiency(leaders[0].fit.prediction if leaders[0].fit else study.nominal)
    _rescore(study)
    for _ in range(options.max_effects - 1):
        leaders = sorted((e for e in study.entries if e.effects), key=lambda e: -float(e.scored.per_unit.sum()))[:2]
        done = True
        for leader in leaders:
            if (
                leader.fit is None
                or len(leader.effects) >= options.max_effects
                or not _material(study, leader.held_out)
            ):
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
    _rescore(study)


def _simplify(study: Study) -> None:
    """Try simpler relatives of the members of the best pair: forward selection starts from whatever single looked best."""
    pairs = [e for e in study.entries if len(e.effects) == 2]
    if not pairs:
        return
    best = max(pairs, key=lambda e: float(e.scored.per_unit.sum()))
    size = {n: len(x.parameters) for n, x in study.problem.effects.items()}
    single = {e.effects[0]: e for e in study.entries if len(e.effects) == 1}
    for member in best.effects:
        (other,) = (n for n in best.effects if n != member)
        if member not in single:
            continue
        reached = float(single[member].scored.per_unit.sum() - study.entry("parameters").scored.per_unit.sum())
        for name, e in single.items():
            gain = float(e.scored.per_unit.sum() - study.entry("parameters").scored.per_unit.sum())
            relative = name not in best.effects and size[name] < size[member] and gain > 0.8 * reached > 0
            if relative and e.fit is not None and within_budget(study.clock, study.seconds_per_call, 40):
                _refine_shortlist(study, e.fit, screen(study.fitter, e.fit, [other], study.ways), 1)


def _refine_shortlist(study: Study, base: Fit, screened: list[Screened], count: int) -> None:
    known = {frozenset(e.effects) for e in study.entries if e.effects}
    for k, candidate in enumerate(screened[:count]):
        if frozenset((*base.effects, candidate.effect)) in known:
            continue
        if k >= 2 and candidate.gain < 0.1 * max(screened[0].gain, 0.0):
            break
        calls = 8.0 + 3 * study.options.max_iterations
        if k and not within_budget(study.clock, study.seconds_per_call, calls):
            study.warn(f"the budget allowed {k} of {min(count, len(screened))} shortlisted effects")
            break
        fit = refine(study.fitter, base, candidate, study.options.max_iterations)
        if fit is not None:
            study.entries.append(_entry(study, fit))


def _rescore(study: Study) -> None:
    """Score everything again under the current efficiencies, so that all are compared alike."""
    for e in study.entries:
        if e.fit is None:
            e.scored = fixed(study.fitter, study.nominal, "none")
        else:
            e.scored = cross_validate(study.fitter, e.fit, study.ways)


# -- concluding ---------------------------------------------------------------------------------------------------------
def _admit(study: Study) -> None:
    """An effect counts only if it beats its parent held out, and its magnitude's interval excludes null."""
    calibration = study.options.calibration
    for e in study.entries:
        if not e.effects or e.fit is None:
            continue
        parents = [
            p for p in study.entries if p.name == "parameters" or (p.effects and set(p.effects) < set(e.effects))
        ]
        parent = max(parents, key=lambda p: float(p.scored.per_unit.sum()))
        gain, se = difference(study.problem, e.scored.per_unit, parent.scored.per_unit)
        e.admissible = gain > calibration.accept_sigma * se and e.gap < parent.gap
        if not _material(study, parent.held_out):  # nothing left to gain, unless it takes odd parameters to get there
            e.admissible = (
                not _material(study, e.held_out)
                and _prior_cost(parent.fit) - _prior_cost(e.fit) > calibration.implausible
            )
        elif len(e.effects) > 1:
            single = min((p for p in parents if p.effects), key=lambda p: p.gap, default=parent)
            e.admissible &= single.gap - e.gap > calibration.pair_share * max(study.entry("parameters").gap - 1.0, 1e-9)
        position = {n: i for i, n in enumerate(e.fit.space.names)}
        for name in e.effects:
            effect = study.problem.effects[name]
            j = position[effect.magnitude]
            null = e.fit.space.encode({effect.magnitude: effect.null})[j] if not effect_is_log(study, name) else -np.inf
            if abs(e.fit.v[j] - null) < 1.96 * e.fit.sd[j]:
                e.admissible = False


def _alone(study: Study, effect: str) -> float:
    """Held-out score of an effect on its own: which of several together matters most."""
    return max((float(e.scored.per_unit.sum()) for e in study.entries if e.effects == (effect,)), default=-np.inf)


def effect_is_log(study: Study, name: str) -> bool:
    """Whether the effect's magnitude lives on a log scale (its null is then out of reach)."""
    effect = study.problem.effects[name]
    return any(p.log for p in effect.parameters if p.name == effect.magnitude)


def _weigh(study: Study) -> Array:
    c = study.options.calibration
    prior = log_priors(
        [(e.name, e.effects) for e in study.entries], c, dict(study.options.prior), len(study.problem.effects)
    )
    prior = prior + np.array([0.0 if e.admissible else -4.0 - 1e3 * (len(e.effects) > 1) for e in study.entries])
    if not _material(study, study.nominal):
        prior = prior + np.array([1e3 if e.name == "none" else 0.0 for e in study.entries])
    extra = {n: len(x.parameters) - 1 for n, x in study.problem.effects.items()}
    prior = prior + c.parameter_log_odds * np.array([float(sum(extra[n] for n in e.effects)) for e in study.entries])
    prior = prior - np.array([_prior_cost(e.fit) for e in study.entries]) / c.prior_temperature
    scores = [e.scored.per_unit for e in study.entries]
    refit = study.entry("parameters")
    if not _material(study, refit.held_out):  # differences below the floor decide nothing
        scores = [refit.scored.per_unit if e.name != "none" and not _material(study, e.held_out) else s
                  for e, s in zip(study.entries, scores, strict=True)]  # fmt: skip
    return weights(study.problem, scores, prior, temperature(study), study.seed)


def temperature(study: Study) -> float:
    """Score difference that counts as one nat: never less than the laws' own precision."""
    c = study.options.calibration
    totals = {e.name: float(e.scored.per_unit.sum()) for e in study.entries}
    return max(c.temperature, c.law_precision * (max(totals.values()) - totals["parameters"]))


def _conclude(study: Study) -> Diagnosis:
    problem, c = study.problem, study.options.calibration
    _admit(study)
    weight = _weigh(study)
    best = study.entries[int(np.argmax(weight))]
    refit = study.entry("parameters")
    closure = study.gauge.closure(study.nominal, refit.held_out, best.held_out, study.seed)
    left = float(np.nanmax(study.gauge.per_observable(study.gauge.squares(best.held_out))))
    open_share = 1.0 - closure.closed if np.isfinite(closure.closed) else 0.0
    p_unknown = unknown_probability(c, open_share, left)
    weight = weight * (1 - p_unknown)
    masses = {"none": 0.0, "parameters": 0.0, "unknown": p_unknown}
    inclusion: dict[str, float] = {}
    for e, w in zip(study.entries, weight, strict=True):
        if not e.effects:
            masses[e.name] += float(w)
        for name in e.effects:
            masses[name] = masses.get(name, 0.0) + float(w) / len(e.effects)
            inclusion[name] = inclusion.get(name, 0.0) + float(w)
    for name in study.options.only or problem.effects:
        masses.setdefault(name, 0.0)
    effect_mass = sum(w for n, w in masses.items() if n in problem.effects)
    totals = {"effect": effect_mass, "parameters": masses["parameters"], "none": masses["none"], "unknown": p_unknown}
    verdict = max(totals, key=lambda k: totals[k])
    if verdict == "effect" and not best.effects:
        best = max((e for e in study.entries if e.effects), key=lambda e: weight[study.entries.index(e)])
        closure = study.gauge.closure(study.nominal, refit.held_out, best.held_out, study.seed)
    if verdict == "effect" and not best.admissible:
        verdict = "parameters" if totals["parameters"] + totals["none"] >= p_unknown else "unknown"
    if verdict in ("parameters", "none"):
        best = study.entry(verdict)
        closure = study.gauge.closure(study.nominal, refit.held_out, best.held_out, study.seed)
    ordered = sorted(masses.items(), key=lambda kv: -kv[1])
    if verdict == "effect":  # the effects of the verdict lead, strongest first
        lead = sorted(best.effects, key=lambda n: (-_alone(study, n), -masses[n]))
        ordered = [(n, masses[n]) for n in lead] + [kv for kv in ordered if kv[0] not in lead]
    stage_of = {n: problem.effects[n].stage for n in problem.effects}
    candidates = tuple(Candidate(n, stage_of.get(n, ""), p) for n, p in ordered)
    names, probabilities = [c.name for c in candidates], [c.probability for c in candidates]
    effects = tuple(FoundEffect(n, stage_of[n], min(1.0, inclusion[n]), _estimates(study, best, n))
                    for n in (x for x in names if verdict == "effect" and x in best.effects))  # fmt: skip
    _fit_warnings(study, best)
    unknown = (
        describe(study.problem, study.gauge, study.fitter.noise, best.held_out)
        if _material(study, best.held_out)
        else None
    )
    shares = stage_shares(study.problem, study.fitter, study.gauge, refit.fit, study.screened, study.nominal)
    inseparable = groups(study.problem, study.fitter, [(e.name, e.effects, e.scored.per_unit, e.admissible) for e in study.entries],
                         refit.fit, study.screened, temperature(study))  # fmt: skip
    signals = study.gauge.signals(study.nominal)
    return Diagnosis(
        verdict=verdict,  # type: ignore[arg-type]
        sentence=sentence(verdict, effects, closure, unknown, inseparable),
        effects=effects,
        candidates=candidates,
        credible_set=credible_set(names, probabilities),
        stages=study.gauge.stages(study.nominal, shares),
        phases=study.gauge.phases(study.nominal),
        signals=signals,
        gap=closure,
        inseparable=inseparable,
        next_experiment=None,
        warnings=tuple(study.warnings),
        runtime_s=study.clock.elapsed(),
        closures={
            problem.observables[o].name: study.gauge.closure(study.nominal, refit.held_out, best.held_out, study.seed, o, 100)
            for o in problem.present
        },
        hypotheses=_hypotheses(study, weight),
        parameters=_nuisances(study, best),
        stage_by_phase=study.gauge.stage_by_phase(study.nominal, best.held_out),
        stage_by_condition=study.gauge.stage_by_condition(study.nominal, best.held_out),
        traces=traces(problem, study.gauge, study.fitter.noise, study.nominal, best.held_out),
        unknown=unknown,
        provenance={"seed": study.seed, "simulate_calls": problem.calls, "simulate_seconds": problem.sim_seconds,
                    "failed_simulations": problem.failures, "blocks": len(problem.blocks),
                    "conditions": len(problem.conditions), "samples": int(problem.mask.sum()),
                    "effects_in_library": len(problem.effects), "python": platform.python_version(),
                    "numpy": np.__version__},
    )  # fmt: skip


def _estimates(study: Study, entry: Entry, effect: str) -> dict[str, Estimate]:
    own = {p.name for p in study.problem.effects[effect].parameters}
    return {n: e for n, e in _all_estimates(study, entry).items() if n in own}


def _nuisances(study: Study, entry: Entry) -> dict[str, Estimate]:
    own = {p.name for p in study.problem.parameters}
    if entry.fit is None:
        return {
            p.name: Estimate(p.nominal, p.nominal, p.nominal, p.unit, p.nominal, p.stage)
            for p in study.problem.parameters
        }
    return {n: e for n, e in _all_estimates(study, entry).items() if n in own}


def _all_estimates(study: Study, entry: Entry) -> dict[str, Estimate]:
    fit = entry.fit
    assert fit is not None
    spread = np.std(entry.scored.fold_v, axis=0) if len(entry.scored.fold_v) > 1 else np.zeros(len(fit.space))
    intervals = fit.space.interval(fit.v, np.hypot(fit.sd, spread))
    bound = set(fit.space.at_bounds(fit.v))
    return {p.name: Estimate(fit.values[p.name], *intervals[p.name], p.unit, p.nominal, p.stage, p.name in bound)
            for p in fit.space.parameters}  # fmt: skip


def _fit_warnings(study: Study, entry: Entry) -> None:
    if entry.fit is None:
        return
    bound = entry.fit.space.at_bounds(entry.fit.v)
    if bound:
        study.warn(f"fitted value on its bound, often the sign of a missing effect: {', '.join(bound)}")
    if len(entry.scored.fold_v) > 1:
        wander = np.ptp(entry.scored.fold_v, axis=0) / np.maximum(4 * entry.fit.sd, 0.05)
        moving = [n for n, w in zip(entry.fit.space.names, wander, strict=True) if w > 3]
        if moving:
            study.warn(f"values that change with the blocks they are fitted to: {', '.join(moving[:6])}")
    if study.problem.failures:
        study.warn(f"{study.problem.failures} simulations failed and were left out")


def _hypotheses(study: Study, weight: Array) -> tuple[Hypothesis, ...]:
    reference = study.entry("parameters").scored.per_unit
    rows = []
    for e, w in zip(study.entries, weight, strict=True):
        gain, se = difference(study.problem, e.scored.per_unit, reference)
        rows.append(Hypothesis(e.effects, e.name, float(w), gain, se, e.gap, e.fit.values if e.fit is not None else {}))
    return tuple(sorted(rows, key=lambda h: -h.probability))
