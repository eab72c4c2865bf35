"""Refitting the parameters alone, and the floor by which everything is judged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pianobot_ros.gap.fitting.fit import Fit, Fitter
from pianobot_ros.gap.fitting.score import cross_validate, fixed
from pianobot_ros.gap.floor.courses import Drift, find_drift
from pianobot_ros.gap.floor.measure import Gauge
from pianobot_ros.gap.floor.noise import NoiseModel
from pianobot_ros.gap.floor.splice import inherited
from pianobot_ros.gap.problem.constants import LOWER
from pianobot_ros.gap.problem.options import Options
from pianobot_ros.gap.problem.problem import Problem
from pianobot_ros.gap.problem.types import Array
from pianobot_ros.gap.search.contenders import gain, leaders
from pianobot_ros.gap.search.study import (
    Entry,
    Study,
    believed,
    make_entry,
    pooled,
    simulate_folds,
)


def fit_parameters(study: Study) -> Fit:
    """Refit the nuisances alone; take the floor from the better residual; put "none" and
    "parameters" on the table.
    """
    problem, noise = study.problem, study.fitter.noise
    study.fitter = fitter = Fitter(problem, noise, study.nominal)
    fit = fitter.start((), np.zeros(len(problem.parameters)))
    # for the floor only: as far as it goes without new derivatives
    fit = fitter.refine(fit, study.options.max_iterations, [])
    if problem.recentre(fit.values):
        fit = replace(fit, prediction=problem.predict(fit.values, ()))
    problem.leave_out_vanished(fit.prediction)
    residual = problem.y - fit.prediction
    drift = find_drift(problem, residual, fit.jacobian, study.options.calibration.material_share)
    noise = noise_of(
        problem, residual if drift is None else residual - drift.residual, study.options
    )
    for o, old in fitter.noise.noises.items():
        if old.floor < noise.noises[o].floor:
            noise.noises[o] = old
    noise.inherited = inherited(problem, noise.rebuilt().floor, fit.values)
    _judge_by(study, noise, fit.prediction)
    fit = study.fitter.refine(fit, study.options.max_iterations)
    _tell(study, noise, drift)
    _put_parameters(study, fit)
    return fit


def noise_of(problem: Problem, residual: Array, options: Options) -> NoiseModel:
    """The floor by a residual (size,); lone strays of events are left out from now on."""
    noise = NoiseModel(problem, residual, options)
    if not noise.lone:
        return noise
    problem.leave_out(noise.lone)
    return NoiseModel(problem, residual, options)


def _judge_by(study: Study, noise: NoiseModel, prediction: Array) -> None:
    """Fit and measure under another floor from now on, as efficient as at `prediction`."""
    noise = noise.rebuilt()
    study.fitter = Fitter(study.problem, noise, prediction)
    study.gauge = Gauge(study.problem, noise)


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


def lower_floor(study: Study) -> bool:
    """Take the floor from the leader's residual where repeats scatter far less under it: what it
    explains was no scatter. Returns whether it was.

    A clock that runs away moves every note from its repeats; a further effect would hide in that.
    """
    leader, old = leaders(study)[0], study.fitter.noise
    if leader.fit is None or gain(study, leader) <= 0:
        return False
    found = NoiseModel(study.problem, study.problem.y - leader.fit.prediction, study.options)
    lower = [o for o, noise in found.noises.items() if noise.floor < LOWER * old.noises[o].floor]
    if not lower:
        return False
    for o in set(found.noises) - set(lower):
        found.noises[o] = old.noises[o]
    found.inherited = old.inherited
    _judge_by(study, found, leader.fit.prediction)
    study.warn(
        f"repeats of {', '.join(study.problem.observables[o].name for o in lower)} differ by what"
        f" {leader.name} explains: it counts as gap, not as scatter"
    )
    rescore(study)
    for e in study.entries:
        e.gap, e.settled = pooled(study, e.held_out), False
    return True


def judge_at(study: Study, leader: Entry) -> None:
    """Score everything anew, with as many independent samples as the leader leaves."""
    at = leader.fit.prediction if leader.fit else study.nominal
    study.fitter = Fitter(study.problem, study.fitter.noise, at)
    rescore(study)


def rescore(study: Study) -> None:
    """Score everything again under the current efficiencies, so that all are compared alike."""
    for e in study.entries:
        e.tried_from = None  # costs are counted otherwise now
        if e.fit is None:
            e.scored = fixed(study.fitter, study.nominal, "none")
        else:
            e.scored = believed(study, cross_validate(study.fitter, e.fit, study.ways), e.held_out)
