"""Which effects deserve a full fit: linearised screening of the library, refinement of the shortlist, forward selection.

Every effect is simulated once at each of its starts on top of the current best fit. The change it makes is a direction in
the space of predictions; how much of the held-out residual that direction explains, with all nuisance parameters free to move
along, is a matter of small linear solves. Only the best few are then fitted in full.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pianobot_ros.gap.fit import Fit, Fitter
from pianobot_ros.gap.quadratic import extend, summed
from pianobot_ros.gap.score import held_out, refit
from pianobot_ros.gap.space import Space
from pianobot_ros.gap.timing import Stopwatch
from pianobot_ros.gap.types import Array, Parameter

LEAST_RELIEF = 0.1
SCALE = Parameter("scale of the signature", 0.0, 0.0, 1.6, sd=1.0)


@dataclass(frozen=True)
class Screened:
    """One effect at its best start: linearised held-out gain over `base`, and where to start the full fit."""

    effect: str
    gain: float
    start: Mapping[str, float]
    v: Array
    signature: Array
    """Whitened change of the prediction (size,) that the effect makes at this start."""
    change: Array
    """The same, not whitened."""
    relief: Array
    """Share of every observable's whitened squares (o,) that goes, linearised: negative where it grows."""


class Clock:
    """The budget, in seconds of :class:`Stopwatch`."""

    def __init__(self, seconds: float) -> None:
        self._watch = Stopwatch()
        self._seconds = seconds

    def left(self) -> float:
        """Seconds left."""
        return self._seconds - self._watch.used()

    def used(self) -> float:
        """Seconds used of the budget."""
        return self._watch.used()

    def elapsed(self) -> float:
        """Wall seconds since the start."""
        return self._watch.elapsed()


def screen(fitter: Fitter, base: Fit, names: list[str], ways: list[Array]) -> list[Screened]:
    """All effects `names` on top of the fitted `base`, best first."""
    problem = fitter.problem
    white = fitter.whitened(base)
    quad = fitter.quadratic(white)
    weight = np.where(problem.mask, white.weight, 0.0)
    reference = float(held_out(fitter, quad, base.space, base.v, ways)[0].sum())
    values = base.values
    trials = [(n, start) for n in names for start in problem.effects[n].starts]
    requests = []
    for name, start in trials:
        effect = problem.effects[name]
        own = {p.name: p.nominal for p in effect.parameters} | dict(start)
        requests.append(({**values, **own}, (*base.effects, name)))
    best: dict[str, Screened] = {}
    space = Space((*base.space.parameters, SCALE))
    v0 = np.append(base.v, 0.0)
    before = np.maximum(summed(quad).mean(np.zeros(len(base.space))), 1e-12)
    for (name, start), result in zip(trials, problem.predict_many(requests), strict=True):
        if isinstance(result, Exception):
            continue
        signature = fitter.noise.whiten(result - base.prediction)
        if float(np.sum(weight * signature**2)) < 1e-6:
            continue
        wide = extend(quad, white.z, white.jacobian, signature, problem.runs, weight)
        each, _ = held_out(fitter, wide, space, v0, ways)
        step, after = refit(fitter, summed(wide), space, v0)
        moved = v0 + step
        relief = 0.5 * float(base.v @ base.v - moved[:-1] @ moved[:-1])  # parameters may return to where they belong
        gain = float(each.sum()) - reference + max(relief, 0.0)
        if name in best and gain <= best[name].gain:
            continue
        best[name] = Screened(name, gain, start, _start(fitter, base, name, start, moved), signature,
                              result - base.prediction, 1.0 - after / before)  # fmt: skip
    return sorted(best.values(), key=lambda s: -s.gain)


def shortlist(screened: list[Screened], count: int, open_observables: list[int], each: int = 2) -> list[Screened]:
    """The `count` best by gain, and for every open observable the `each` that relieve it most.

    A long series can outvote forty events: without the second rule an effect that shows in events alone is never looked at.
    """
    chosen = screened[:count]
    for o in open_observables:
        for s in sorted(screened, key=lambda s: -s.relief[o])[:each]:
            if s.relief[o] > LEAST_RELIEF and s not in chosen:
                chosen = [*chosen, s]
    return chosen


def _start(fitter: Fitter, base: Fit, name: str, start: Mapping[str, float], moved: Array) -> Array:
    """Full parameter vector: base moved along, the effect at its start with the magnitude scaled."""
    effect = fitter.problem.effects[name]
    own = {p.name: p.nominal for p in effect.parameters} | dict(start)
    scale = float(np.clip(moved[-1], 0.1, 1.6))
    own[effect.magnitude] = effect.null + scale * (own[effect.magnitude] - effect.null)
    tail = Space(effect.parameters)
    shift = np.clip(moved[:-1], base.v - 3.0, base.v + 3.0)
    return np.concatenate([shift, tail.clip(tail.encode(own))])


def refine(fitter: Fitter, base: Fit, screened: Screened, iterations: int) -> Fit | None:
    """Full fit of `base` plus one effect; None if the twin cannot simulate it."""
    effects = (*base.effects, screened.effect)
    n = len(base.space)
    space = fitter.space(effects)
    unmoved = np.concatenate([base.v, screened.v[n:]])
    starts = [space.clip(v) for v in (screened.v, unmoved)]
    cost, v = min(((fitter.cost_at(effects, space, v), v) for v in starts), key=lambda start: start[0])
    if cost == np.inf:
        return None
    fit = fitter.start(effects, v, base.jacobian)
    return fitter.refine(fit, iterations, list(range(n, len(space))))


def within_budget(clock: Clock, seconds_per_call: float, calls: float, reserve: float = 0.15) -> bool:
    """Whether so many more calls of the twin still fit, keeping a share in reserve."""
    return clock.left() > seconds_per_call * calls + reserve * clock.used()
