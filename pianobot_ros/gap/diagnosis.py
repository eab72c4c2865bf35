"""The result of a diagnosis: what diagnosis.json holds, and the traces and tables that a report
draws.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from pianobot_ros.gap.problem.types import Array

Verdict = Literal["effect", "parameters", "none", "unknown"]


@dataclass(frozen=True)
class Estimate:
    """A parameter's value with its 95 % interval; `nominal` is what the twin had before.

    `by_chance` is the interval in which another recording would find it: what the twin is wrong by,
    it is wrong by there, too.
    """

    value: float
    low: float
    high: float
    unit: str
    nominal: float = math.nan
    stage: str = ""
    at_bound: bool = False
    by_chance: tuple[float, float] = (-math.inf, math.inf)


@dataclass(frozen=True)
class FoundEffect:
    """An effect that the verdict names: `probability` is that it is part of the truth."""

    name: str
    stage: str
    probability: float
    parameters: Mapping[str, Estimate]


@dataclass(frozen=True)
class Candidate:
    """A name of the library with its `description` there, or "parameters", "none", "unknown". The
    probabilities of all candidates add up to 1.
    """

    name: str
    stage: str
    probability: float
    description: str = ""


@dataclass(frozen=True)
class Hypothesis:
    """One fitted hypothesis (effects together): its weight and its held-out score against
    "parameters" ± standard error.
    """

    effects: tuple[str, ...]
    name: str
    probability: float
    score: float
    score_se: float
    gap: float
    values: Mapping[str, float] = field(default_factory=dict)
    """Fitted values of all its parameters."""


@dataclass(frozen=True)
class Row:
    """A line of the gap table: `gap` and `floor` are RMS in units of the floor; `share` of the gap
    above the floor.
    """

    name: str
    gap: float
    floor: float
    share: float
    stage: str = ""
    unit: str = ""
    rms: float = math.nan
    floor_si: float = math.nan
    description: str = ""


@dataclass(frozen=True)
class Closure:
    """Held-out gap before, after refitting parameters only, after the effect; closed fraction with
    its 95 % interval; apart, what refitting closes (of the gap above the floor) and what the effect
    closes of what refitting leaves above the floor (NaN where that is nothing).
    """

    metric: str
    unit: str
    floor: float
    before: float
    refit: float
    after: float
    closed: float
    closed_low: float
    closed_high: float
    closed_by_parameters: float = math.nan
    closed_by_effect: float = math.nan
    closed_by_effect_low: float = math.nan
    closed_by_effect_high: float = math.nan

    @property
    def widened(self) -> bool:
        """Whether refitting made the gap wider, by a percent at least."""
        share = self.closed_by_parameters
        return math.isfinite(share) and round(100 * share) < 0


@dataclass(frozen=True)
class Fold:
    """``values`` of all parameters, fitted without the ``blocks`` (names)."""

    blocks: tuple[str, ...]
    values: Mapping[str, float]


@dataclass(frozen=True)
class Measure:
    """A measure of how far twin and robot are apart, held out, ``before`` and ``after`` adopting;
    ``low`` to ``high`` is the 95 % interval of its change.
    """

    before: float
    after: float
    low: float
    high: float


@dataclass(frozen=True)
class Offer:
    """The hypothesis that may be adopted: its ``effects``, its ``folds`` for who wants to predict
    what was held out, and its ``measures`` by name ("gap", in floors; a twin may add its own).
    """

    effects: tuple[str, ...] = ()
    folds: tuple[Fold, ...] = ()
    measures: Mapping[str, Measure] = field(default_factory=dict)


@dataclass(frozen=True)
class Trace:
    """Measured against twin before, refitted and after, of one observable in one block; times
    start at the block's own 0. ``typical``: the block in the middle of the ranking of the
    observable's gap.
    """

    block: str
    condition: str
    observable: str
    stage: str
    unit: str
    floor: float
    t: Array
    real: Array
    before: Array
    refit: Array
    after: Array
    typical: bool = False


@dataclass(frozen=True)
class GapMap:
    """Gap in floor units: `values` (rows, columns), NaN where nothing was measured."""

    rows: tuple[str, ...]
    columns: tuple[str, ...]
    before: Array
    after: Array

    def to_json(self) -> dict[str, Any]:
        """The map before, with null where nothing was measured."""
        return dict(_plain({"rows": self.rows, "columns": self.columns, "values": self.before}))


@dataclass(frozen=True)
class Dependency:
    """How an unexplained residual depends on one feature: `explained` held-out share, and `curves`
    of the feature (n,) and the mean residual there (n,): one, or forwards and backwards apart.
    """

    feature: str
    unit: str
    explained: float
    text: str
    curves: tuple[tuple[Array, Array], ...] = ()


@dataclass(frozen=True)
class UnknownDescription:
    """What is left of the gap, in plain words and as dependencies, best first."""

    observable: str
    stage: str
    unit: str
    text: str
    dependencies: tuple[Dependency, ...]


@dataclass(frozen=True)
class Diagnosis:
    """Everything that was found; `to_json` is the contract, the rest is for the report."""

    verdict: Verdict
    sentence: str
    effects: tuple[FoundEffect, ...]
    candidates: tuple[Candidate, ...]
    credible_set: tuple[str, ...]
    stages: tuple[Row, ...]
    phases: tuple[Row, ...]
    signals: tuple[Row, ...]
    gap: Closure
    inseparable: tuple[tuple[str, ...], ...]
    next_experiment: Mapping[str, Any] | None
    warnings: tuple[str, ...]
    runtime_s: float
    closures: Mapping[str, Closure] = field(default_factory=dict)
    hypotheses: tuple[Hypothesis, ...] = ()
    hiding: tuple[Hypothesis, ...] = ()
    """Effects that may hide where refitting closes the gap, at a size that the data allow."""
    parameters: Mapping[str, Estimate] = field(default_factory=dict)
    """Of what the verdict offers, beside its effects; refitted alone where it offers nothing."""
    offer: Offer = field(default_factory=Offer)
    stage_by_phase: GapMap | None = None
    stage_by_condition: GapMap | None = None
    traces: tuple[Trace, ...] = ()
    unknown: UnknownDescription | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """The contract's dictionary: only plain JSON types, NaN as null."""
        document = {
            "verdict": self.verdict,
            "sentence": self.sentence,
            "effects": [_effect(e) for e in self.effects],
            "candidates": [_some(c, "name", "stage", "probability") for c in self.candidates],
            "credible_set": self.credible_set,
            "stages": [_some(r, *OF_A_ROW) for r in self.stages],
            "phases": [_some(r, *OF_A_ROW) for r in self.phases],
            "signals": [_signal(r, self.closures.get(r.name)) for r in self.signals],
            "gap": vars(self.gap),
            "stage_by_phase": self.stage_by_phase and self.stage_by_phase.to_json(),
            "inseparable": self.inseparable,
            "unknown": self.unknown and _unknown(self.unknown),
            "parameters": {n: _some(p, *OF_A_VALUE, "nominal") for n, p in self.parameters.items()},
            "adopting": {n: vars(m) for n, m in self.offer.measures.items()},
            "next_experiment": self.next_experiment,
            "warnings": self.warnings,
            "runtime_s": self.runtime_s,
            "provenance": self.provenance,
        }
        return dict(_plain(document))

    def write_json(self, path: str | Path) -> None:
        """Write diagnosis.json."""
        Path(path).write_text(
            json.dumps(self.to_json(), indent=1, allow_nan=False) + "\n", encoding="utf-8"
        )


OF_A_ROW = ("name", "gap", "floor", "share")
OF_A_VALUE = ("value", "low", "high", "unit")


def _some(thing: object, *names: str) -> dict[str, Any]:
    """Attributes of a thing by name."""
    return {n: getattr(thing, n) for n in names}


def _effect(e: FoundEffect) -> dict[str, Any]:
    values = {n: _some(p, *OF_A_VALUE) for n, p in e.parameters.items()}
    return _some(e, "name", "stage", "probability") | {"parameters": values}


def _signal(r: Row, closure: Closure | None) -> dict[str, Any]:
    """A line of the signals' table with what refitting and the verdict leave."""
    return {
        **_some(r, "name", "stage", "gap", "floor", "share", "unit", "rms"),
        "floor_rms": r.floor_si,
        "refit": closure and closure.refit,
        "after": closure and closure.after,
    }


def _unknown(u: UnknownDescription) -> dict[str, Any]:
    shown = [_some(d, "feature", "explained", "text") for d in u.dependencies]
    return _some(u, "observable", "stage", "text") | {"dependencies": shown}


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
