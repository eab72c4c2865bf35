"""How far the parameters of a fit may be from the machine's.

The curvature of the likelihood takes all that is not explained for noise, which averages out. What
a twin or a law is wrong by does not: it is the same wherever it acts. So three things are added to
the curvature (law of propagation, JCGM 100:2008, 5.2.2, with inputs that are correlated):

- values that differ from block to block, by those fitted without each fold;
- the error of the twin, its tolerance and what is left, the same in all blocks: it moves a
  parameter by the sum of what it moves it by in each, not by the root of the sum of their squares;
- the error of a law, a share of what the law does (`law_error`), one for each observable.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy.special import ndtri, stdtrit

from pianobot_ros.gap.fitting.evidence import Evidence
from pianobot_ros.gap.fitting.fit import Fit
from pianobot_ros.gap.problem.constants import UPPER
from pianobot_ros.gap.problem.errors import SimulationFailed
from pianobot_ros.gap.problem.types import Array


def by_chance(fit: Fit, fold_v: Array) -> Array:
    """Standard deviation (p,) of a fit's parameters, in those of their priors, over recordings of
    one machine and one twin. `fold_v` (folds, p) were fitted without each fold.
    """
    return np.asarray(np.hypot(fit.sd, _apart(fold_v)))


def deviation(evidence: Evidence, fit: Fit, fold_v: Array, left: Array) -> Array:
    """The same, with what the twin and its laws are wrong by; `left` (o,) is the systematic squared
    gap that the fit leaves of each observable, in floors².
    """
    gain = evidence.fitter.gain(fit)
    return np.asarray(
        np.sqrt(
            by_chance(fit, fold_v) ** 2
            + _by_the_twin(evidence, gain, np.sqrt(left) * evidence.fitter.noise.floor)
            + _by_laws(evidence, fit, gain)
        )
    )


def _apart(fold_v: Array) -> Array:
    """Standard deviation (p,) of values that differ from block to block, by those fitted without
    each fold (folds, p): a jackknife of groups (Efron 1982, *The jackknife*, 3), times what
    Student's t has more than a normal distribution has for so few.
    """
    free = max(len(fold_v) - 1, 0)
    if not free:
        return np.zeros(fold_v.shape[1])
    wider = np.sqrt(free) * stdtrit(free, UPPER) / ndtri(UPPER)
    return np.asarray(wider * np.std(fold_v, axis=0))


def _by_the_twin(evidence: Evidence, gain: Array, left: Array) -> Array:
    """Variance (p,) that the twin's error gives the parameters, beyond that of a tolerance which is
    another one in each condition: this the curvature has. `gain` (size, p) is what each sample
    moves them by; what is `left` (o,) of each observable, in its unit, is such an error, too.

    It may be any, so one is taken along each parameter's own signature: as fast as it changes its
    sign, and alike in all blocks.
    """
    problem, noise = evidence.problem, evidence.fitter.noise
    count = gain.shape[1]
    shared = np.zeros((len(problem.observables), count))
    chance = np.zeros((len(problem.observables), len(problem.conditions), count))
    for c in problem.cells:
        tolerance, tau, keep = noise.tolerance_of(c)
        error, moved = np.hypot(tolerance, left[c.observable]), gain[c.start + keep]
        condition = problem.condition_of_block[c.block]
        shared[c.observable] += _root(c.t[keep], np.abs(moved) * error[:, None], tau)
        chance[c.observable, condition] += _root(c.t[keep], moved * tolerance[:, None], tau)
    return np.asarray(np.square(shared).sum(0) - np.square(chance).sum((0, 1)))


def _root(t: Array, moved: Array, tau: float) -> Array:
    return np.asarray(np.sqrt(np.maximum(correlated_variance(t, moved, tau), 0.0)))


def _by_laws(evidence: Evidence, fit: Fit, gain: Array) -> Array:
    """Variance (p,) that the laws' own error gives the parameters."""
    problem = evidence.problem
    if not fit.effects:
        return np.zeros(gain.shape[1])
    bare = {p.name: fit.values[p.name] for p in problem.parameters}
    try:
        without = problem.predict(bare, ())
    except SimulationFailed:
        return np.zeros(gain.shape[1])
    moved = gain * (fit.prediction - without)[:, None]
    each = np.array([moved[(problem.obs_of == o) & problem.mask].sum(0) for o in problem.present])
    share = evidence.options.calibration.law_error
    return np.asarray(np.square(share * each).sum(0))


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def correlated_variance(t: Array, moved: Array, tau: float) -> Array:  # pragma: no cover
    """Variance (p,) of the sum over samples of `moved` (n, p), times an Ornstein-Uhlenbeck process
    of unit variance and correlation time `tau` at the times `t` (n,).
    """
    n, p = moved.shape
    out, past = np.zeros(p), np.zeros(p)
    for i in range(n):
        decay = 0.0 if i == 0 else np.exp(-max(t[i] - t[i - 1], 0.0) / tau)
        for j in range(p):
            past[j] *= decay
            out[j] += moved[i, j] * (moved[i, j] + 2.0 * past[j])
            past[j] += moved[i, j]
    return out
