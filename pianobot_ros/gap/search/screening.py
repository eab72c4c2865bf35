"""Which effects deserve a full fit: linearised screening of the library, refinement of the
shortlist, forward selection.

Every effect is simulated once at each of its starts on top of the refitted parameters. The change
it makes (its signature) is a direction in the space of predictions; how much of the held-out
residual that direction explains, with all nuisance parameters free to move along, is a matter of
small linear solves, on top of any other fit too. Only the best few are then fitted in full.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pianobot_ros.gap.fitting.fit import Fit, Fitter
from pianobot_ros.gap.fitting.quadratic import Quadratic, extend, summed, unhidden
from pianobot_ros.gap.fitting.score import box, held_out, refit
from pianobot_ros.gap.fitting.space import Space
from pianobot_ros.gap.floor.measure import Gauge
from pianobot_ros.gap.problem.constants import FAR, NEGLIGIBLE, SMALL
from pianobot_ros.gap.problem.problem import Request
from pianobot_ros.gap.problem.types import Array, Parameter

SCALE = Parameter("scale of the signature", 0.0, 0.0, 1.6, sd=1.0)


@dataclass(frozen=True)
class Screened:
    """One effect at its best start: linearised held-out gain over `base` (nats that count), and
    where to start the full fit.
    """

    effect: str
    gain: float
    natural: float
    """What of the gain is that parameters may stay where they belong."""
    start: Mapping[str, float]
    v: Array
    signature: Array
    """Whitened change of the prediction (size,) that the effect makes at this start."""
    change: Array
    """The same, not whitened."""
    moved: Array
    """What the prediction (size,) changes by where its size is as it fits best, linearised, with
    the parameters that move along.
    """
    relief: Array
    """Share of every observable's squared gap above the floor's square (o,) that goes, linearised:
    negative where it grows, 0 where there is none.
    """

    def relieves(self, observables: Iterable[int]) -> bool:
        """Whether it relieves any of them enough to be looked at for it."""
        return any(self.relief[o] > SMALL for o in observables)


@dataclass(frozen=True)
class Signature:
    """Change (size,) of a prediction that an effect makes at one of its starts."""

    effect: str
    start: Mapping[str, float]
    change: Array


@dataclass(frozen=True)
class _Trial:
    """A signature with the linearised fit of its size and the nuisances."""

    of: Signature
    white_change: Array
    wide: Quadratic
    moved: Array
    cost: float


def squared_gaps(gauge: Gauge, prediction: Array) -> Array:
    """Squared gap of every observable (o,), in floors²; 0 where it was not measured."""
    return np.asarray(np.nan_to_num(gauge.gaps(prediction)) ** 2)


def relief(before: Array, after: Array) -> Array:
    """Share of squared gaps (o,) above the floor's square that goes; 0 where there is none."""
    above = before > 1.0
    return np.where(above, (before - after) / np.where(above, before - 1.0, 1.0), 0.0)


def signatures(
    fitter: Fitter, base: Fit, trials: Iterable[tuple[str, Mapping[str, float]]]
) -> list[Signature]:
    """Simulate effects at starts on top of `base`; those that the twin cannot simulate are left
    out.
    """
    trials, known, problem = list(trials), base.values, fitter.problem
    requests: list[Request] = [
        (known | problem.effects[n].at(start), (*base.effects, n)) for n, start in trials
    ]
    each: dict[str, list[Signature]] = {}
    for (name, start), result in zip(trials, problem.predict_many(requests), strict=True):
        if not isinstance(result, Exception):
            each.setdefault(name, []).append(Signature(name, start, result - base.prediction))
    beside = _Beside(fitter, base)
    return [s for own in each.values() for s in _within_reach(beside, own)]


@dataclass(frozen=True)
class _Beside:
    """What a fit leaves (size,), and how much changes beside it act (L2, whitened) that its
    parameters do not hide.
    """

    fitter: Fitter
    fit: Fit

    @cached_property
    def left(self) -> Array:
        return np.asarray(self.fitter.problem.y - self.fit.prediction)

    @cached_property
    def _jacobian(self) -> Array:
        return self.fitter.noise.whiten(self.fit.jacobian)

    @cached_property
    def open(self) -> float:
        """How much what is left acts."""
        return self.acts(self.left)

    @cached_property
    def floors(self) -> float:
        """How large what is left is, in floors."""
        return self.in_floors(self.left)

    def acts(self, change: Array) -> float:
        square = unhidden(self.fitter.noise.whiten(change), self._jacobian)
        return float(np.sqrt(max(float(square), 0.0)))

    def in_floors(self, change: Array) -> float:
        return float(np.linalg.norm(self.fitter.noise.normalise(change)))


def _within_reach(beside: _Beside, own: list[Signature]) -> list[Signature]:
    """An effect's `own` signatures, the least of which is seen at another size where that of every
    start is out of reach.

    A start is believed to be right to an order of magnitude. Where what it changes is far more than
    all that is left to explain, also where parameters have moved to meet it, it is another law that
    is seen there (a limit that a loop runs away from): the effect is seen at the size at which it
    changes as much.
    """
    if SMALL * min(beside.in_floors(s.change) for s in own) <= beside.floors:
        return own  # nothing need be whitened to see that
    sizes = [beside.acts(s.change) for s in own]
    k = int(np.argmin(sizes))
    if not SMALL * sizes[k] > beside.open > 0.0:
        return own
    name, start, share = own[k].effect, own[k].start, beside.open / sizes[k]
    found = _acting(beside.fitter, beside.fit, name, start, share, beside.open, beside.acts)
    if found is None:
        return own
    at = beside.fitter.problem.effects[name].shrunk(start, found[0])
    return [*own[:k], Signature(name, at, found[1]), *own[k + 1 :]]


def _acting(
    fitter: Fitter,
    base: Fit,
    name: str,
    start: Mapping[str, float],
    share: float,
    asked: float,
    acts: Callable[[Array], float],
) -> tuple[float, Array] | None:
    """The share of its size at a `start` at which an effect on top of `base` acts, by the measure
    `acts` of a change (size,), about as much as is `asked`, and that change; None where there is
    none.

    Most laws act in proportion to their size. A limit does nothing up to a size, and much beyond:
    from where it does nothing no fit leads anywhere. The size is looked for by bisection, from a
    first `share` to a hundredth.
    """
    problem, low, high = fitter.problem, 0.0, 1.0
    effect, effects = problem.effects[name], (*base.effects, name)
    while 0.0 < share < 1.0 and high - low > NEGLIGIBLE:
        values = {**base.values, **effect.shrunk(start, share)}
        (found,) = problem.predict_many([(values, effects)])
        if isinstance(found, Exception):
            return None
        change = found - base.prediction
        size = acts(change)
        if 0.5 * asked <= size <= 2.0 * asked:
            return share, change
        low, high = (share, high) if size < asked else (low, share)
        share = 0.5 * (low + high)
    return None


def screen(
    fitter: Fitter,
    base: Fit,
    known: Iterable[Signature],
    ways: Sequence[Array],
    gauge: Gauge,
    temperature: Array,
) -> list[Screened]:
    """The effects of the signatures `known`, each at its best, on top of the fitted `base`, best
    first. `temperature` (o,): score that counts as one nat.
    """
    problem = fitter.problem
    white = fitter.whitened(base)
    quad = white.products
    weight = np.where(problem.mask, white.weight, 0.0)
    doubt = fitter.noise.options.calibration.prior_temperature
    reference = float((held_out(fitter, quad, base.space, base.v, ways)[0] / temperature).sum())
    space = Space((*base.space.parameters, SCALE))
    v0 = np.append(base.v, 0.0)
    bounds = box(space, v0)
    whole = summed(quad)
    before = squared_gaps(gauge, base.prediction)
    alone = base.v + refit(fitter, whole, base.v, *box(base.space, base.v))[0]
    best: dict[str, _Trial] = {}
    for one in known:
        white_change = fitter.noise.whiten(one.change)
        if float(np.sum(weight * white_change**2)) < 1e-6:
            continue
        wide = extend(quad, white.z, white.jacobian, white_change, problem.runs, weight)
        step, after = refit(fitter, summed(wide), v0, *bounds)
        moved = v0 + step
        cost = fitter.likelihood.data_cost(after) + 0.5 * float(moved[:-1] @ moved[:-1])
        if one.effect not in best or cost < best[one.effect].cost:
            best[one.effect] = _Trial(one, white_change, wide, moved, cost)
    out = []
    for trial in best.values():
        each, _ = held_out(fitter, trial.wide, space, v0, ways)
        stretched = float(alone @ alone - trial.moved[:-1] @ trial.moved[:-1])
        natural = max(0.5 * stretched / doubt, 0.0)
        shift = base.jacobian @ (trial.moved[:-1] - base.v) + trial.moved[-1] * trial.of.change
        out.append(
            Screened(
                trial.of.effect,
                float((each / temperature).sum()) - reference + natural,
                natural,
                trial.of.start,
                _start(fitter, base, trial.of.effect, trial.of.start, trial.moved),
                trial.white_change,
                trial.of.change,
                shift,
                relief(before, squared_gaps(gauge, base.prediction + shift)),
            )
        )
    return sorted(out, key=lambda s: -s.gain)


def shortlist(
    screened: Sequence[Screened], count: int, open_observables: list[int]
) -> list[Screened]:
    """The `count` best by gain, and for every open observable the one that relieves it most.

    A long series can outvote forty events: without the second rule an effect that shows in events
    alone is never looked at.
    """
    chosen = list(screened[:count])
    for o in open_observables if screened else ():
        s = max(screened, key=lambda s: float(s.relief[o]))
        if s.relieves([o]) and s not in chosen:
            chosen.append(s)
    return chosen


def _start(fitter: Fitter, base: Fit, name: str, start: Mapping[str, float], moved: Array) -> Array:
    """Full parameter vector: base moved along, the effect at its start with the magnitude
    scaled.
    """
    effect = fitter.problem.effects[name]
    own = effect.shrunk(start, float(np.clip(moved[-1], SMALL, SCALE.high)))
    tail = Space(effect.parameters)
    shift = np.clip(moved[:-1], base.v - FAR, base.v + FAR)
    return np.concatenate([shift, tail.clip(tail.encode(own))])


def begin(fitter: Fitter, base: Fit, screened: Screened) -> list[Fit]:
    """Where full fits of `base` plus one effect begin: at the size that the linear fit found, and
    where the law does not do there what was asked of it, at the size at which it does. Empty
    where the twin cannot simulate any.
    """
    effects = (*base.effects, screened.effect)
    n = len(base.space)
    space = fitter.space(effects)
    found = []
    for size in _sizes(fitter, base, screened):
        starts = [space.clip(np.concatenate([v, size])) for v in (screened.v[:n], base.v)]
        cost, v = min(
            ((fitter.likelihood.cost_at(effects, space, v), v) for v in starts),
            key=lambda start: start[0],
        )
        if cost < np.inf:
            found.append(fitter.start(effects, v, base.jacobian))
    return found


def _sizes(fitter: Fitter, base: Fit, screened: Screened) -> list[Array]:
    """The effect's own parameters as the linear fit found them, and at the size at which it changes
    the prediction by as much as that asked for.
    """
    effect = fitter.problem.effects[screened.effect]
    own = Space(effect.parameters)
    first = screened.v[len(base.space) :]
    values = own.decode(first)
    start = effect.at(screened.start)
    share = (values[effect.magnitude] - effect.null) / (start[effect.magnitude] - effect.null)
    asked = share * float(np.linalg.norm(screened.signature))

    def acts(change: Array) -> float:
        return float(np.linalg.norm(fitter.noise.whiten(change)))

    found = _acting(fitter, base, effect.name, start, share, asked, acts)
    if found is None or found[0] == share:
        return [first]
    at = effect.shrunk(start, found[0])[effect.magnitude]
    return [first, own.encode({**values, effect.magnitude: at})]
