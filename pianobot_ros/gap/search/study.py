"""The state of one diagnosis: hypotheses on the table, and the few questions that every step asks
of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import norm

from pianobot_ros.gap.diagnosis import Closure
from pianobot_ros.gap.fitting.fit import Fit, Fitter
from pianobot_ros.gap.fitting.score import Scored, cross_validate, fixed
from pianobot_ros.gap.floor.measure import Gauge, assemble
from pianobot_ros.gap.problem.constants import LINEARISATION_LIMIT
from pianobot_ros.gap.problem.options import Options
from pianobot_ros.gap.problem.problem import Problem
from pianobot_ros.gap.problem.types import Array
from pianobot_ros.gap.search.screening import Screened, Signature

Progress = Callable[[str, float, tuple[tuple[str, float], ...]], None]
"""Called with what is being done, the share of the work that is done (0 to 1), and the leading
effects with their weights so far, best first.
"""


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
    settled: bool = False
    dominated: bool = False
    simulated: bool = True
    """Whether `held_out` was simulated; else it is linearised at the fit."""
    tried_from: Fit | None = None
    """The best fit from whose values it has been fitted anew."""
    closure: Closure | None = None
    """How far it closes the gap, once asked for."""
    line: float | None = None
    """Frequency (Hz) of a disturbance that it only looks like, 0 for none, once asked for."""

    @property
    def score(self) -> float:
        """Held-out log score over all units, not tempered (see :func:`standing`)."""
        return float(self.scored.per_unit.sum())


@dataclass
class Study:
    """State of one diagnosis."""

    problem: Problem
    options: Options
    seed: int
    fitter: Fitter
    gauge: Gauge
    ways: list[Array]
    nominal: Array
    entries: list[Entry] = field(default_factory=list)
    signatures: list[Signature] = field(default_factory=list)
    """Of the library, on top of the refitted parameters."""
    screened: list[Screened] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    progress: Progress | None = None

    def warn(self, text: str) -> None:
        """Remember a warning once."""
        if text not in self.warnings:
            self.warnings.append(text)

    def entry(self, name: str) -> Entry:
        """Entry by name."""
        return next(e for e in self.entries if e.name == name)

    def replace(self, old: Entry, new: Entry) -> None:
        """Put one hypothesis in another's place."""
        self.entries[self.entries.index(old)] = new


def make_entry(study: Study, fit: Fit, settled: bool = False) -> Entry:
    """Score a fit held out, linearised: each unit with the parameters of the folds that left it
    out.
    """
    scored = cross_validate(study.fitter, fit, study.ways)
    shift = (scored.fold_v - fit.v)[study.ways[0]]
    moved = np.einsum("ij,ij->i", fit.jacobian, shift[study.problem.unit_of])
    flat = fit.prediction + moved
    gap = pooled(study, flat)
    return Entry(fit.name, fit.effects, scored, fit, flat, gap, settled=settled, simulated=False)


def simulate_folds(study: Study, e: Entry) -> None:
    """Simulate each block with the parameters of the folds that left it out, once: what is reported
    or may lead must not rest on a line.
    """
    if e.simulated or e.fit is None:
        return
    way, space = study.ways[0], e.fit.space
    parts = [
        (np.flatnonzero(way == k), space.decode(space.clip(v)))
        for k, v in enumerate(e.scored.fold_v)
    ]
    e.held_out = assemble(study.problem, parts, e.effects, study.warn)
    e.scored, e.gap = believed(study, e.scored, e.held_out), pooled(study, e.held_out)
    e.simulated = True


def believed(study: Study, scored: Scored, held_out: Array) -> Scored:
    """A linearised score, or that of the simulated folds where a law with jumps makes it far worse
    than these.
    """
    simulated = fixed(study.fitter, held_out, scored.name).each
    return (
        replace(scored, each=simulated)
        if scored.each.sum() < LINEARISATION_LIMIT * simulated.sum()
        else scored
    )


def pooled(study: Study, prediction: Array) -> float:
    """Pooled gap of a flat prediction in floors."""
    return study.gauge.pooled(study.gauge.squares(prediction))


def gaps(study: Study, e: Entry) -> Array:
    """Held-out gap of every observable (o,) in floors, 0 where it was not measured."""
    return np.nan_to_num(study.gauge.gaps(e.held_out))


def material(study: Study, prediction: Array) -> bool:
    """Whether the systematic gap of any observable (or event) exceeds the material share of its
    floor.
    """
    return bool(open_observables(study, prediction))


def anything(study: Study) -> bool:
    """Whether the nominal twin's gap is more than chance makes of a perfect twin's.

    Of several observables one is open by chance more often than each: the error is that of the
    family (Šidák 1967, Journal of the American Statistical Association 62). Logarithms of mean
    squares are compared, whose error does not grow with the gap.
    """
    c = study.options.calibration
    each = 1.0 - (1.0 - c.false_alarm) ** (1.0 / max(len(study.problem.present), 1))
    squares = study.gauge.squares(study.nominal)
    mean = np.maximum(np.nan_to_num(study.gauge.per_observable(squares)) ** 2, 1.0)
    chance = norm.isf(each) * study.gauge.per_observable_error(squares) / mean
    return bool(np.any(np.log(mean) > np.maximum(np.log1p(c.material**2), chance)))


def open_observables(
    study: Study, prediction: Array, size: float | Array | None = None, sigma: float | None = None
) -> list[int]:
    """Observables whose systematic gap is above `size` floors (of all or of each (o,); default:
    material) and no accident of blocks, widest first.

    No accident: the squared gap is `sigma` (default: open_sigma) standard errors above the floor's
    square.
    """
    squares = study.gauge.squares(prediction)
    c = study.options.calibration
    each = np.nan_to_num(study.gauge.per_observable(squares), nan=0.0)
    accident = (c.open_sigma if sigma is None else sigma) * study.gauge.per_observable_error(
        squares
    )
    limit = 1.0 + np.maximum(np.square(c.material if size is None else size), accident)
    return [int(o) for o in np.argsort(-each) if each[o] ** 2 > limit[o]]


def prior_cost(fit: Fit | None, count: int | None = None) -> float:
    """How far (nats) the prior of the first `count` parameters (default: all) had to be stretched.

    A missing effect is often absorbed by implausible values.
    """
    return 0.0 if fit is None else 0.5 * float(fit.v[:count] @ fit.v[:count])


def tempered(study: Study, e: Entry) -> Array:
    """Held-out score per unit (u,) in nats that count."""
    return np.asarray((e.scored.each / temperatures(study)).sum(1))


def standing(study: Study, e: Entry) -> float:
    """Held-out score over all units in nats that count: by it hypotheses are looked for, as by it
    they are weighed.
    """
    return float(tempered(study, e).sum())


def temperatures(study: Study) -> Array:
    """Score difference that counts as one nat, by observable (o,): never less than the laws' own
    precision there.

    By observable, because a long series that the best hypothesis explains a thousand times over
    must not drown forty events.
    """
    c = study.options.calibration
    base = np.array(
        [
            c.event_temperature if o.kind == "event" else c.temperature
            for o in study.problem.observables
        ]
    )
    best = max(study.entries, key=lambda e: e.score)
    gained = (best.scored.each - study.entry("parameters").scored.each).sum(0)
    return np.asarray(np.maximum(base, c.law_precision * gained))
