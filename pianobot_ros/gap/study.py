"""The state of one diagnosis: hypotheses on the table, and the few questions that every step asks of them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pianobot_ros.gap.fit import Fit, Fitter
from pianobot_ros.gap.measure import Gauge, assemble
from pianobot_ros.gap.options import Options
from pianobot_ros.gap.problem import Problem
from pianobot_ros.gap.score import Scored, cross_validate
from pianobot_ros.gap.search import Clock, Screened
from pianobot_ros.gap.types import Array


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


def make_entry(study: Study, fit: Fit) -> Entry:
    """Score a fit held out, and simulate each block with the parameters of the folds that left it out."""
    scored = cross_validate(study.fitter, fit, study.ways)
    way = study.ways[0]
    parts = [(np.flatnonzero(way == k), fit.space.decode(fit.space.clip(v))) for k, v in enumerate(scored.fold_v)]
    flat = assemble(study.problem, parts, fit.effects, study.warn)
    return Entry(fit.name, fit.effects, scored, fit, flat, pooled(study, flat))


def pooled(study: Study, prediction: Array) -> float:
    """Pooled gap of a flat prediction in floors."""
    return study.gauge.pooled(study.gauge.squares(prediction))


def material(study: Study, prediction: Array) -> bool:
    """Whether the systematic gap of any observable (or event) exceeds the material share of its floor."""
    return bool(open_observables(study, prediction))


def open_observables(study: Study, prediction: Array) -> list[int]:
    """Observables whose gap is material, widest first."""
    each = np.nan_to_num(study.gauge.per_observable(study.gauge.squares(prediction)), nan=0.0)
    limit = float(np.hypot(1.0, study.options.calibration.material))
    return [int(o) for o in np.argsort(-each) if each[o] > limit]


def prior_cost(fit: Fit | None) -> float:
    """How far (nats) the prior had to be stretched. A missing effect is often absorbed by implausible parameters."""
    return 0.0 if fit is None else 0.5 * float(fit.v @ fit.v)
