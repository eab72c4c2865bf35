"""What an observable inherits from the sensor whose signal is spliced in before it.

A signal that is measured is right to within its own floor: nobody claims less of it. Behind a
splice the same error is another one: a force that is wrong by a hundredth throws a light key
through half its travel. So the deviation of one floor of the signal, in proportion to it as laws of
sensors are (gain, creep, hysteresis), is passed through the twin, and each sample that is predicted
from the signal has what comes out as a deviation of its own, to first order (GUM, JCGM 100:2008,
5.1.2). It belongs to the recording and to no hypothesis: all are judged by the same floor.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from pianobot_ros.gap.floor.estimate import lasting
from pianobot_ros.gap.floor.noise import NoiseModel
from pianobot_ros.gap.floor.unrepeated import noisy
from pianobot_ros.gap.problem.constants import TINY
from pianobot_ros.gap.problem.problem import Problem
from pianobot_ros.gap.problem.types import Array


def passed_on(noise: NoiseModel, values: Mapping[str, float]) -> NoiseModel:
    """The floor with what each sample inherits by these `values` of the twin's parameters."""
    problem = noise.problem
    rounding, rate = rounded(noise, values)
    deviation = np.hypot(inherited(problem, noise.floor, values), rounding)
    return NoiseModel(problem, noise.options, noise.estimates, deviation, rate)


def rounded(noise: NoiseModel, values: Mapping[str, float]) -> tuple[Array, Array]:
    """Standard deviation (size,) that samples have from what the signals spliced in before them are
    rounded by, and that of its rate (1/s), where repeats are rounded alike and their scatter shows
    nothing of it.

    What the twin predicts of such a signal is rounded on a grid that lies elsewhere, and what that
    changes, as large and as slow as the error there is, is done to what was measured: RMS over each
    observable of what its predictions change by.
    """
    problem, noises = noise.problem, noise.estimates.noises
    coarse = {problem.observables[o].signal: o for o, own in noises.items() if own.rounding}
    cells = [c for o in coarse.values() for c in problem.cells_of(o)]
    nothing = np.zeros(problem.size), np.zeros(problem.size)
    if not cells:
        return nothing
    others, rng = dict(enumerate(problem.blocks)), np.random.default_rng(0)
    plain = problem.predict(values, ())
    for c in cells:
        name, block = problem.observables[c.observable].signal, others[c.block]
        step, phase = float(np.sqrt(12.0)) * noises[c.observable].rounding, rng.uniform()
        s = block.outputs[name]
        like = np.interp(s.t, c.t, plain[c.start : c.stop]) / step
        once_more = replace(s, y=s.y + step * (np.round(like + phase) - phase - like))
        others[c.block] = replace(block, outputs={**block.outputs, name: once_more})
    moved = problem.predict_blocks(others, values)
    if isinstance(moved, Exception):
        return nothing
    deviation, rate = nothing
    change = np.where(problem.mask, moved - plain, np.nan)
    for o in problem.present:
        cells, own = problem.cells_of(o), problem.obs_of == o
        deviation[own] = np.sqrt(np.nanmean(change[own] ** 2))
        lasts = lasting([(c.t, change[c.start : c.stop]) for c in cells], 0.0)
        rate[own] = deviation[own] / lasts
    return deviation, rate


def inherited(problem: Problem, floor: Array, values: Mapping[str, float]) -> Array:
    """Standard deviation (size,) that each sample has from what is spliced in before it, in its own
    unit; 0 where nothing is.

    `floor` (o,) of the observables, in their units; `values` of the twin's parameters, without any
    effect.
    """
    names = [o.name for o in problem.observables]
    out = np.zeros(problem.size)
    ways = {
        (o.spliced, o.gain)
        for k, o in enumerate(problem.observables)
        if o.spliced and o.gain and k in problem.present
    }
    for spliced, gain in sorted(ways):
        source = problem.mask & (problem.obs_of == names.index(spliced))
        size = float(np.sqrt(np.mean(problem.y[source] ** 2))) if source.any() else 0.0
        if size <= 0.0:
            continue
        share = floor[names.index(spliced)] / size
        requests = [
            ({**values, gain: values[gain] * x}, ())
            for x in (1.0, 1.0 + share, 1.0 / (1.0 + share))
        ]
        base, *moved = problem.predict_many(requests)
        behind = np.array([o.spliced == spliced and o.gain == gain for o in problem.observables])
        own = behind[problem.obs_of] & problem.mask
        changes = [
            m - base
            for m in moved
            if not isinstance(m, Exception) and not isinstance(base, Exception)
        ]
        if changes:
            out[own] = np.sqrt(np.mean(np.square(changes), axis=0))[own]
    return out


def noise_followed(
    noise: NoiseModel, values: Mapping[str, float], effect: str, seed: int = 0
) -> Array:
    """How much of what an effect changes at `values` is white noise of the measured signals that it
    follows: by observable (o,), shares of the squares of the whole change as the likelihood sees
    it (whitened); further noise of that size is drawn. Their sum is by how much the effect is
    fitted too small where outliers count in full, as of friction by a velocity that was not
    smoothed (Fuller 1987, Measurement Error Models). What the twin says nothing of in any of these
    predictions does not count: what stands in there has no noise. 0 where the twin fails.
    """
    problem, noises = noise.problem, noise.estimates.noises
    white = {
        obs.signal: noises[o].white
        for o, obs in enumerate(problem.observables)
        if o in noises and obs.kind == "series"
    }
    rng = np.random.default_rng(seed)
    others = {b: noisy(block, white, rng) for b, block in enumerate(problem.blocks)}
    own_values = {p.name for p in problem.effects[effect].parameters}
    plain = {n: x for n, x in values.items() if n not in own_values}
    asked: list[tuple[Mapping[str, float], tuple[str, ...]]] = [(plain, ()), (values, (effect,))]
    found = [*problem.predict_many(asked), *(problem.predict_blocks(others, *r) for r in asked)]
    flat = [x for x in found if not isinstance(x, Exception)]
    if len(flat) < len(found):
        return np.zeros(len(problem.observables))
    used = problem.mask & ~problem.silent(*asked[1])
    for request in asked:
        used &= ~problem.silent(*request, others)
    own = flat[1] - flat[0]
    squares = [noise.whiten(np.where(used, x, 0.0)) ** 2 for x in (own, (flat[3] - flat[2]) - own)]
    whole = max(float(np.sum(squares[0])), TINY)
    return np.bincount(problem.obs_of, squares[1], len(problem.observables)) / whole
