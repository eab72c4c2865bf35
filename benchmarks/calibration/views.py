"""What is known of a cell beside what is said of it: once as it is, once without its cause."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from pianobot_ros.gap import Options
from pianobot_ros.gap.posterior.probabilities import posterior
from pianobot_ros.gap.posterior.table import Table, first_of, inclusion, masses_of, recalibrated
from pianobot_ros.gap.posterior.verdict import group_of
from pianobot_ros.gap.problem.options import Calibration, Scaling
from pianobot_ros.gap.search.study import Study

__all__ = [
    "AS_SET",
    "FACTORS",
    "Answer",
    "Factors",
    "Truth",
    "View",
    "answer",
    "answer_by",
    "seen",
    "without",
]

Factors = tuple[float, float]
"""Of the temperatures of series and of events."""
AS_SET: Factors = (1.0, 1.0)
OCTAVES = (0.5, 1.0, 2.0, 4.0)
FACTORS: tuple[Factors, ...] = tuple(product(OCTAVES, OCTAVES))
"""What is tried: scores of either kind are believed twice as much, as they are, or less."""


@dataclass(frozen=True)
class Truth:
    """What was done to a cell: its `kind` ("effect", "two", "none", "parameters", "unknown"), the
    `effects`, and what a single one's withheld family may be answered with, beside *unknown*.
    """

    kind: str
    effects: tuple[str, ...]
    relatives: frozenset[str] = frozenset()


@dataclass(frozen=True)
class View:
    """One cell, seen with the whole library or without its cause: what the scores say. `names`:
    what is true, all of which a credible set must hold (of relatives `any_of` them).
    """

    cell: str
    names: tuple[str, ...]
    any_of: bool
    table: Table

    @property
    def group(self) -> str:
        """Group of the first answer."""
        return group_of(first_of(masses_of(self.table)))


@dataclass(frozen=True)
class Answer:
    """What is said of a view: the `first` answer with its probability, whether it is `right`, the
    probability of the `truth`, and the mass that comes `before` it in a credible set.
    """

    first: str
    probability: float
    right: bool
    truth: float
    before: float


def seen(path: Path, truth: Truth, options: Options) -> dict[Factors, list[View]]:
    """Views of a kept study: as it is, and without its cause if that is one effect of the library;
    by factors of the temperatures.
    """
    study: Study = pickle.loads(path.read_bytes())
    names = truth.effects if truth.kind in ("effect", "two") else (truth.kind,)
    asked = [(study, names, False)]
    if truth.kind == "effect":
        instead = ("unknown", *sorted(truth.relatives))
        asked.append((without(study, truth.effects[0]), instead, True))
    # what is simulated for the first posterior need not be for the others
    asked = [(posterior(s).study, true, any_of) for s, true, any_of in asked]
    c = options.calibration
    out = {}
    for series, event in FACTORS:
        tempered = replace(
            options,
            calibration=replace(
                c, temperature=series * c.temperature, event_temperature=event * c.event_temperature
            ),
        )
        out[series, event] = [
            View(path.stem, names, any_of, posterior(replace(s, options=tempered)).table)
            for s, names, any_of in asked
        ]
    return out


def without(study: Study, effect: str) -> Study:
    """The study as if the library had lacked an effect."""
    problem = copy.copy(study.problem)
    problem.effects = {n: e for n, e in problem.effects.items() if n != effect}
    left = tuple(e for e in study.entries if effect not in e.effects)
    screened = tuple(s for s in study.screened if s.effect != effect)
    return replace(study, problem=problem, entries=left, screened=screened)


def answer(view: View, scalings: Mapping[Any, Scaling]) -> Answer:
    """What is said of a view by these scalings."""
    table = recalibrated(view.table, Calibration(scaling=scalings))
    given = answer_by(masses_of(table), view.names, view.any_of)
    return replace(given, probability=inclusion(table, given.first))


def answer_by(masses: Mapping[str, float], names: Sequence[str], any_of: bool) -> Answer:
    """The same from the probabilities of all names."""
    ranked = sorted(masses.items(), key=lambda kv: -kv[1])
    first, probability = ranked[0]
    before = dict(
        zip((n for n, _ in ranked), np.cumsum([0.0, *(p for _, p in ranked)]), strict=False)
    )
    each = [float(before.get(n, 1.0)) for n in names]
    truth = sum(masses.get(n, 0.0) for n in names)
    return Answer(first, probability, first in names, truth, min(each) if any_of else max(each))
