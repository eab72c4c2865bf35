"""The result of a diagnosis: what diagnosis.json holds, and the traces and tables that a report draws."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from pianobot_ros.gap.types import Array

Verdict = Literal["effect", "parameters", "none", "unknown"]


@dataclass(frozen=True)
class Estimate:
    """A parameter's value with its 95 % interval; `nominal` is what the twin had before."""

    value: float
    low: float
    high: float
    unit: str
    nominal: float = math.nan
    stage: str = ""
    at_bound: bool = False


@dataclass(frozen=True)
class FoundEffect:
    """An effect that the verdict names: `probability` is that it is part of the truth."""

    name: str
    stage: str
    probability: float
    parameters: Mapping[str, Estimate]


@dataclass(frozen=True)
class Candidate:
    """A name of the library, or "parameters", "none", "unknown". The probabilities of all candidates add up to 1."""

    name: str
    stage: str
    probability: float


@dataclass(frozen=True)
class Hypothesis:
    """One fitted hypothesis (effects together): its weight and its held-out score against "parameters" ± standard error."""

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
    """A line of the gap table: `gap` and `floor` are RMS in units of the floor; `share` of the gap above the floor."""

    name: str
    gap: float
    floor: float
    share: float
    stage: str = ""
    unit: str = ""
    rms: float = math.nan
    floor_si: float = math.nan


@dataclass(frozen=True)
class Closure:
    """Held-out gap before, after refitting parameters only, after the effect; closed fraction with its 95 % interval."""

    metric: str
    unit: str
    floor: float
    before: float
    refit: float
    after: float
    closed: float
    closed_low: float
    closed_high: float


@dataclass(frozen=True)
class Trace:
    """Measured against twin before and after, of one observable in one block; times start at the block's own 0."""

    block: str
    condition: str
    observable: str
    stage: str
    unit: str
    floor: float
    t: Array
    real: Array
    before: Array
    after: Array


@dataclass(frozen=True)
class GapMap:
    """Gap in floor units: `values` (rows, columns), NaN where nothing was measured."""

    rows: tuple[str, ...]
    columns: tuple[str, ...]
    before: Array
    after: Array


@dataclass(frozen=True)
class Dependency:
    """How an unexplained residual depends on one feature: centres (n,), mean residual (n,), explained held-out share."""

    feature: str
    unit: str
    explained: float
    centre: Array
    mean: Array
    spread: Array
    by_direction: bool
    text: str


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
    parameters: Mapping[str, Estimate] = field(default_factory=dict)
    stage_by_phase: GapMap | None = None
    stage_by_condition: GapMap | None = None
    traces: tuple[Trace, ...] = ()
    unknown: UnknownDescription | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """The contract's dictionary: only plain JSON types, NaN as null."""
        found = [
            {"name": e.name, "stage": e.stage, "probability": e.probability,
             "parameters": {n: {"value": p.value, "low": p.low, "high": p.high, "unit": p.unit}
                            for n, p in e.parameters.items()}}
            for e in self.effects
        ]  # fmt: skip
        gap = self.gap
        document = {
            "verdict": self.verdict,
            "sentence": self.sentence,
            "effects": found,
            "candidates": [{"name": c.name, "stage": c.stage, "probability": c.probability} for c in self.candidates],
            "credible_set": list(self.credible_set),
            "stages": [{"name": r.name, "gap": r.gap, "floor": r.floor, "share": r.share} for r in self.stages],
            "phases": [{"name": r.name, "gap": r.gap, "floor": r.floor, "share": r.share} for r in self.phases],
            "signals": [
                {"name": r.name, "stage": r.stage, "gap": r.gap, "floor": r.floor, "share": r.share, "unit": r.unit,
                 "rms": r.rms, "floor_rms": r.floor_si}
                for r in self.signals
            ],
            "gap": {"metric": gap.metric, "unit": gap.unit, "floor": gap.floor, "before": gap.before, "refit": gap.refit,
                    "after": gap.after, "closed": gap.closed, "closed_low": gap.closed_low,
                    "closed_high": gap.closed_high},
            "inseparable": [list(g) for g in self.inseparable],
            "unknown": None if self.unknown is None else {
                "observable": self.unknown.observable, "stage": self.unknown.stage, "text": self.unknown.text,
                "dependencies": [{"feature": d.feature, "explained": d.explained, "text": d.text}
                                 for d in self.unknown.dependencies]},
            "parameters": {n: {"value": p.value, "low": p.low, "high": p.high, "unit": p.unit, "nominal": p.nominal}
                           for n, p in self.parameters.items()},
            "next_experiment": None if self.next_experiment is None else dict(self.next_experiment),
            "warnings": list(self.warnings),
            "runtime_s": self.runtime_s,
            "provenance": dict(self.provenance),
        }  # fmt: skip
        return dict(_plain(document))

    def write_json(self, path: str | Path) -> None:
        """Write diagnosis.json."""
        Path(path).write_text(json.dumps(self.to_json(), indent=1, allow_nan=False) + "\n", encoding="utf-8")


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
