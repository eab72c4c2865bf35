"""Hypotheses on the table, and what every step asks of them. A step makes a new study of the one
before; none changes what another holds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from pianobot_ros.gap.fitting.evidence import Evidence, pooled, told
from pianobot_ros.gap.fitting.fit import Fit, Fitter
from pianobot_ros.gap.fitting.score import Scored, cross_validate, fixed
from pianobot_ros.gap.problem.constants import MOST
from pianobot_ros.gap.problem.errors import SimulationFailed
from pianobot_ros.gap.problem.types import Array
from pianobot_ros.gap.search.screening import Screened, Signature

__all__ = [
    "Entry",
    "Progress",
    "Study",
    "affords",
    "believed",
    "gaps",
    "make_entry",
    "put",
    "simulated",
    "standing",
    "stretched",
    "temperatures",
    "tempered",
]

Progress = Callable[[str, float, tuple[tuple[str, float], ...]], None]
"""Called with what is being done, the share of the work that is done (0 to 1), and the leading
effects with their weights so far, best first.
"""


@dataclass(frozen=True, eq=False)
class Entry:
    """A hypothesis on the table: `held_out` prediction (size,) with its pooled `gap` (floors)."""

    name: str
    scored: Scored
    fit: Fit
    """Of "none": that of no parameter."""
    held_out: Array
    gap: float
    settled: bool = False
    simulated: bool = True
    """Whether `held_out` was simulated; else it is linearised at the fit."""
    tried_from: Fit | None = None
    """The best fit from whose values it has been fitted anew."""

    @property
    def effects(self) -> tuple[str, ...]:
        """Its effects."""
        return self.fit.effects

    @property
    def score(self) -> float:
        """Held-out log score over all units, not tempered (see :func:`standing`)."""
        return float(self.scored.per_unit.sum())


@dataclass(frozen=True)
class Study(Evidence):
    """Evidence with the hypotheses on the table, each name once: "none" and "parameters" first."""

    entries: tuple[Entry, ...] = ()
    signatures: tuple[Signature, ...] = ()
    """Of the library, on top of the refitted parameters."""
    screened: tuple[Screened, ...] = ()

    def entry(self, name: str) -> Entry:
        """Entry by name."""
        return next(e for e in self.entries if e.name == name)


def put(study: Study, *entries: Entry) -> Study:
    """The study with these hypotheses, in the place of those of the same names."""
    by_name = {e.name: e for e in study.entries} | {e.name: e for e in entries}
    return replace(study, entries=tuple(by_name.values()))


def affords(study: Study, fits: int = 1, besides: int = 0) -> bool:
    """Whether the budget allows so many fits, of a prediction a step, and predictions `besides`."""
    return study.problem.allows(besides + fits * study.options.max_iterations)


def make_entry(evidence: Evidence, fit: Fit, settled: bool = False) -> Entry:
    """Score a fit held out, linearised: each unit with the parameters of the folds that left it
    out.
    """
    scored = cross_validate(evidence.fitter, fit, evidence.ways)
    shift = (scored.fold_v - fit.v)[evidence.ways[0]]
    moved = np.einsum("ij,ij->i", fit.jacobian, shift[evidence.problem.unit_of])
    flat = fit.prediction + moved
    gap = pooled(evidence, flat)
    return Entry(fit.name, scored, fit, flat, gap, settled=settled, simulated=False)


def simulated(study: Study, e: Entry) -> Study:
    """The study with each block simulated by the parameters of the folds that left it out, once:
    what is reported or may lead must not rest on a line.
    """
    if e.simulated:
        return study
    failed: list[str] = []
    fold_v = e.scored.fold_v.copy()
    held_out = _by_folds(study, e, dict(enumerate(fold_v)), failed)
    anew = {}
    for k in _missed(study, e.held_out, held_out):
        if study.problem.allows(study.options.triage_iterations):
            anew[k] = fold_v[k] = _without_fold(study, e.fit, k)
    if anew:
        again = _by_folds(study, e, anew, failed)
        held_out = np.where(np.isnan(again), held_out, again)
    scored = believed(study, replace(e.scored, fold_v=fold_v), held_out)
    gap = pooled(study, held_out)
    new = replace(e, held_out=held_out, scored=scored, gap=gap, simulated=True)
    return told(put(study, new), *failed)


def _by_folds(study: Study, e: Entry, fold_v: Mapping[int, Array], failed: list[str]) -> Array:
    """Each block of these folds simulated by the parameters (p,) that were fitted without it; NaN
    of others. Why a part of it is not held out is added to `failed`.
    """
    problem, way, space = study.problem, study.ways[0], e.fit.space
    out = np.full(problem.size, np.nan)
    for k, v in fold_v.items():
        blocks = {b: problem.blocks[b] for b in np.unique(problem.block_of_unit[way == k]).tolist()}
        prediction = problem.predict_blocks(blocks, space.decode(space.clip(v)), e.effects)
        if isinstance(prediction, SimulationFailed):
            failed.append("a held-out prediction failed; the in-sample one was used there")
            prediction = e.fit.prediction
        own = (way == k)[problem.unit_of]
        out[own] = prediction[own]
    return out


def _missed(study: Study, line: Array, held_out: Array) -> list[int]:
    """The folds where a simulation is materially elsewhere than the line (size,) by which their
    parameters were fitted. What was measured there is not asked.
    """
    gauge, way = study.gauge, study.ways[0]
    squares = gauge.squares(study.problem.y - (held_out - line))
    apart = [
        np.nan_to_num(gauge.per_observable(squares, np.flatnonzero(way == k)))
        for k in range(int(way.max()) + 1)
    ]
    return [k for k, d in enumerate(apart) if np.any(d > study.options.calibration.material)]


def _without_fold(study: Study, fit: Fit, k: int) -> Array:
    """Parameters (p,) fitted by simulation to all units but those of a fold: along a bent valley
    the step that a line takes leads out of it.
    """
    kept = study.problem.of_units(study.ways[0] != k)
    fitter = Fitter(kept, study.fitter.noise, fit.prediction)
    return fitter.refine(fit, study.options.triage_iterations, []).v


def believed(evidence: Evidence, scored: Scored, held_out: Array) -> Scored:
    """A linearised score, or that of the simulated folds where a law with jumps makes it far worse
    than these.
    """
    each = fixed(evidence.fitter, held_out)
    return replace(scored, each=each) if MOST * scored.each.sum() < each.sum() else scored


def gaps(evidence: Evidence, e: Entry) -> Array:
    """Held-out gap of every observable (o,) in floors, 0 where it was not measured."""
    return np.nan_to_num(evidence.gauge.gaps(e.held_out))


def tempered(study: Study, e: Entry, base: Entry | None = None) -> Array:
    """Held-out score per unit (u,) in nats that count, of hypotheses that are built on `base`
    (default: refitting alone).
    """
    return np.asarray((e.scored.each / temperatures(study, base)).sum(1))


def stretched(study: Study, e: Entry) -> bool:
    """Whether a hypothesis asks more of an effect than its law may give: its size sits on the far
    end of its range. A cause of that size is another one.
    """
    held, values = set(e.fit.space.at_bounds(e.fit.v)), e.fit.values
    for effect in (study.problem.effects[n] for n in e.effects):
        size = effect.size
        if size.name in held and not size.same(values[size.name], effect.null):
            return True
    return False


def standing(study: Study, e: Entry) -> float:
    """Held-out score over all units in nats that count: by it hypotheses are looked for, as by it
    they are weighed.
    """
    return float(tempered(study, e).sum())


def temperatures(study: Study, base: Entry | None = None) -> Array:
    """Score difference that counts as one nat, by observable (o,), of hypotheses that are built on
    `base` (default: refitting alone): never less than the precision there of the laws that they add
    to it.

    By observable, because a long series that the best hypothesis explains a thousand times over
    must not drown forty events.
    """
    c, base = study.options.calibration, base or study.entry("parameters")
    least = np.array(
        [
            c.event_temperature if o.kind == "event" else c.temperature
            for o in study.problem.observables
        ]
    )
    built = [e for e in study.entries if set(e.effects) >= set(base.effects)]
    best = max(built, key=lambda e: e.score)
    gained = (best.scored.each - base.scored.each).sum(0)
    return np.asarray(np.maximum(least, c.law_precision * gained))
