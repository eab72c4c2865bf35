"""Refitting the parameters alone, and the floor by which everything is judged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

import numpy as np

from pianobot_ros.gap.fitting.evidence import (
    Evidence,
    implausible,
    judged_by,
    pooled,
    prior_cost,
    told,
)
from pianobot_ros.gap.fitting.fit import Fit, Fitter
from pianobot_ros.gap.fitting.score import Scored, cross_validate, fixed
from pianobot_ros.gap.fitting.space import Space
from pianobot_ros.gap.floor.estimate import Estimates, estimates
from pianobot_ros.gap.floor.noise import NoiseModel
from pianobot_ros.gap.floor.repeats import lie_close, unshared_inputs
from pianobot_ros.gap.floor.session.courses import Drift, find_drift, without_courses
from pianobot_ros.gap.floor.splice import passed_on
from pianobot_ros.gap.floor.whitening.random_effects import directions
from pianobot_ros.gap.problem.constants import MOST
from pianobot_ros.gap.problem.options import Options
from pianobot_ros.gap.problem.problem import Problem
from pianobot_ros.gap.problem.types import Array
from pianobot_ros.gap.search.contenders import gain, leaders
from pianobot_ros.gap.search.study import Entry, Study, believed, make_entry, put, simulated

__all__ = [
    "Lowered",
    "estimated",
    "fit_parameters",
    "floor_under",
    "judge_at",
    "lower_floor",
    "refitted",
    "rescore",
]


CLOSE = (
    "repeats of a condition follow each other, so they may not show what the robot wanders by until"
    " the next condition, which then counts as gap: record all conditions, then all of them again"
)

ONE = (
    "all blocks are of one condition, so what is held out was driven like all else: a law that fits"
    " this motion by chance is not told from the one at work; record other motions, too"
)

UNSHARED = (
    "repeats of a condition differ in {}: but for what goes with its mean, what follows from that"
    " counts as scatter, so a cause that the library lacks may pass for none; give blocks that"
    " differ in an input conditions of their own"
)


def fit_parameters(evidence: Evidence) -> Study:
    """Refit the nuisances alone; take the floor from what that leaves (right parameters may pass
    more noise of what is spliced in on than nominal ones); put "none" and "parameters" on the
    table.
    """
    options = evidence.options
    fitter = Fitter(evidence.problem, evidence.fitter.noise, evidence.nominal)
    fit = fitter.start((), np.zeros(len(evidence.problem.parameters)))
    # for the floor only: as far as it goes without new derivatives
    fit = fitter.refine(fit, options.max_iterations, [])
    if prior_cost(fit) > implausible(evidence):
        fit = _furthest_first(replace(evidence, fitter=fitter), fit)
    problem = evidence.problem.recentred(fit.values)
    if problem is not evidence.problem:
        fit = replace(fit, prediction=problem.predict(fit.values, ()))
    problem = problem.without_vanished(fit.prediction)
    residual = problem.y - fit.prediction
    drift = find_drift(problem, residual, fit.jacobian, options.calibration.material_share)
    if drift is not None:
        residual = residual - drift.residual
    residual, changing = without_courses(problem, residual, options.calibration.material_share)
    along = directions(problem, fit.prediction, fit.jacobian)
    problem, found = estimated(problem, residual, options, fit.values, along)
    noise = passed_on(NoiseModel(problem, options, found), fit.values)
    evidence = judged_by(evidence, noise, fit.prediction)
    fit = evidence.fitter.refine(fit, options.max_iterations)
    said = _said(found, drift, changing)
    if lie_close(problem):
        said.append(CLOSE)
    if len(problem.conditions) == 1:
        said.append(ONE)
    if unshared := unshared_inputs(problem):
        said.append(UNSHARED.format(", ".join(unshared)))
    return _on_table(told(evidence, *problem.warnings, *said), fit)


def _furthest_first(evidence: Evidence, fit: Fit) -> Fit:
    """A refit of the parameters, or what costs less: fitted to the observable that the nominal twin
    is furthest from, as if nothing else had been measured, and from there to all.

    Where a twin runs on by itself, what is furthest off misplaces all else: pulses of a force at
    other moments fit best if they are none, so a gauge's gain falls to its bound, and nothing of
    the force tells of impacts any more. What is furthest off has the widest scale, so the fit of
    all follows it least. New derivatives are taken only where this leads anywhere.
    """
    fitter, most = evidence.fitter, evidence.options.max_iterations
    alone = fitter.only(int(np.argmax(np.nan_to_num(evidence.gauge.gaps(evidence.nominal)))))
    begun = alone.start((), np.zeros(fit.v.size))
    renewed: tuple[list[int] | None, ...] = ([], None)
    for columns in renewed:
        begun = alone.refine(begun, most, columns)
        found = fitter.cheaper(fit, fitter.refine(fitter.start((), begun.v), most, []))
        if found is fit:
            break
        fit = found
    return fit


def estimated(
    problem: Problem,
    residual: Array,
    options: Options,
    values: Mapping[str, float],
    along: Array | None = None,
) -> tuple[Problem, Estimates]:
    """The noise by a residual (size,), that of the twin by these parameters' `values`, blocks that
    may differ `along` directions (size, k), and the problem without lone strays.
    """
    found = estimates(problem, residual, options, values, along)
    if not found.lone:
        return problem, found
    problem = problem.without(found.lone, "far from its repeats and alone in it")
    return problem, estimates(problem, residual, options, values, along)


def _said(found: Estimates, drift: Drift | None, changing: Mapping[str, str]) -> list[str]:
    """What is to be known about the floor."""
    out = []
    if drift is not None:
        went = f"went with {drift.attribute}" if drift.attribute else "drifted over the session"
        out.append(
            f"repeats differ as if {drift.parameter} {went}: it counts as gap, not as scatter"
        )
    each = [
        (
            [name for name, with_it in changing.items() if with_it == attribute],
            f"repeats of {{}} change {f'with {attribute}' if attribute else 'over the session'}:"
            " that counts as gap, not as scatter",
        )
        for attribute in dict.fromkeys(changing.values())
    ]
    for names, said in (
        *each,
        (
            found.estimated,
            "no repeats of a condition for {}: the floor was estimated from high-frequency"
            " residual, so it may be too low",
        ),
        (
            found.humming,
            "a disturbance steady in session time differs between repeats of {}: it counts as gap,"
            " not as scatter",
        ),
        (
            found.unphased,
            "repeats differ by lines that are as large in all blocks, of another phase in each, in"
            " {}: a disturbance on its own clock, which counts as gap, not as scatter",
        ),
        (
            found.erratic,
            "a few repeats are far from the others in {}: they count as gap, not as scatter",
        ),
    ):
        if names:
            out.append(said.format(", ".join(names)))
    return out


def _on_table(evidence: Evidence, fit: Fit) -> Study:
    """The study of nothing but the nominal twin and the refitted one."""
    nominal = evidence.nominal
    none = Scored(fixed(evidence.fitter, nominal), np.zeros((0, 0)))
    nothing, cost = np.zeros(0), evidence.fitter.likelihood.cost(nominal, np.zeros(0))
    unfitted = Fit((), Space(()), nothing, nominal, np.zeros((nominal.size, 0)), cost, nothing)
    study = Study(
        **{f.name: getattr(evidence, f.name) for f in fields(Evidence)},
        entries=(
            Entry("none", none, unfitted, nominal, pooled(evidence, nominal)),
            make_entry(evidence, fit),
        ),
    )
    return simulated(study, study.entry("parameters"))


@dataclass(frozen=True)
class Lowered:
    """A floor under which repeats scatter far less, what is said of it, and the share of the old
    one that is `left` where it fell most.
    """

    noise: NoiseModel
    said: str
    left: float


def floor_under(study: Study, e: Entry, prediction: Array) -> Lowered | None:
    """The floor from what a `prediction` (size,) of a hypothesis leaves, where repeats scatter far
    less under it: what it explains was no scatter. None where that is nowhere, or where the
    hypothesis predicts no better.
    """
    old = study.fitter.noise
    if gain(study, e) <= 0:
        return None
    residual = study.problem.y - prediction
    along = old.estimates.directions
    found = estimates(study.problem, residual, study.options, e.fit.values, along)
    known = old.estimates.noises
    left = {o: noise.floor / known[o].floor for o, noise in found.noises.items()}
    lower = [o for o, share in left.items() if share**2 < MOST]
    if not lower:
        return None
    found = found.keeping(old.estimates, set(found.noises) - set(lower))
    noise = NoiseModel(study.problem, study.options, found, old.inherited, old.rate)
    names = ", ".join(study.problem.observables[o].name for o in lower)
    whose = "repeats" if any(known[o].repeats for o in lower) else "blocks, which nothing repeats,"
    said = f"{whose} differ in {names} by what {e.name} explains: it counts as gap, not as scatter"
    return Lowered(noise, said, min(left.values()))


def refitted(study: Study, fit: Fit, floor: Lowered) -> Study:
    """The study of nothing but the nominal twin and the refitted one, fitted on from where it was
    under another floor; the signatures stay, which know nothing of the floor.
    """
    evidence = told(judged_by(study, floor.noise, fit.prediction), floor.said)
    begun = evidence.fitter.start((), fit.v)
    fit = evidence.fitter.refine(begun, evidence.options.max_iterations)
    return replace(_on_table(evidence, fit), signatures=study.signatures)


def lower_floor(study: Study) -> Study:
    """The study with the floor from the leader's residual where repeats scatter far less under it:
    what it explains was no scatter. Itself where that is nowhere.

    A clock that runs away moves every note from its repeats; a further effect would hide in that.
    """
    leader = leaders(study)[0]
    floor = floor_under(study, leader, leader.fit.prediction)
    if floor is None:
        return study
    study = rescore(told(judged_by(study, floor.noise, leader.fit.prediction), floor.said))
    anew = [replace(e, gap=pooled(study, e.held_out), settled=False) for e in study.entries]
    return put(study, *anew)


def judge_at(study: Study, leader: Entry) -> Study:
    """The study scored anew, with as many independent samples as the leader leaves."""
    return rescore(judged_by(study, study.fitter.noise, leader.fit.prediction))


def rescore(study: Study) -> Study:
    """The study with all scored under its efficiencies, so that they are compared alike."""
    anew = []
    for e in study.entries:
        if e.name == "none":
            scored = replace(e.scored, each=fixed(study.fitter, e.held_out))
        else:
            scored = believed(study, cross_validate(study.fitter, e.fit, study.ways), e.held_out)
        anew.append(replace(e, scored=scored, tried_from=None))  # costs are counted otherwise now
    return put(study, *anew)
