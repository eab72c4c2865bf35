"""A twin with its fitted values as plain data, and what it predicts of another log of its joint."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pianobot_ros.axis.commissioning.around.other_joints import Others, series_of
from pianobot_ros.axis.laws import kernel
from pianobot_ros.axis.laws.readings import Readings
from pianobot_ros.axis.log import Log
from pianobot_ros.axis.signals.cleaning import Clean, clean
from pianobot_ros.axis.twin.description import HORIZON
from pianobot_ros.axis.twin.servo_axis import ServoAxis
from pianobot_ros.gap import Diagnosis, GapError
from pianobot_ros.gap.problem.types import Array

__all__ = ["Prediction", "fitted", "models", "predict", "predict_all"]

WRITES = "pianobot axis diagnose LOG --json"


def fitted(twin: ServoAxis, found: Diagnosis) -> dict[str, Any]:
    """The twin with the values of the hypothesis that predicts best what it was not fitted to."""
    usable = [h for h in found.hypotheses if h.values] or list(found.hypotheses)
    best = max(usable, key=lambda h: h.score, default=None)
    values = dict(best.values) if best is not None else {}
    vector = twin.joint.vector(values)
    return {
        "hypothesis": best.name if best is not None else "none",
        "effects": list(best.effects) if best is not None else [],
        "values": {n: float(v) for n, v in zip(kernel.NAMES, vector, strict=True)},
        **twin.joint.others.to_json(),
        "unit": twin.joint.unit,
        "effort_unit": twin.joint.scales.effort_unit,
    }


@dataclass(frozen=True)
class Prediction:
    """RMS errors of a fitted twin on a log, in `unit` and `effort_unit`; NaN where there was
    nothing to compare.
    """

    name: str
    joint: str
    position: float
    """Of the position that follows from the command alone, over the whole log."""
    free_motion: float
    """Of the position from the measured effort, over 0.1 s each."""
    effort: float
    """Of the effort that the measured motion needs."""
    following: float
    """Command minus position: what a perfect drive would leave."""
    unit: str
    effort_unit: str

    def to_json(self) -> dict[str, Any]:
        """Plain JSON types; what was not compared is null."""
        flat = asdict(self)
        return {
            k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in flat.items()
        }


def models(path: Path) -> dict[str, Mapping[str, Any]]:
    """Fitted twins by joint from what `diagnose --json` wrote; raises GapError if it holds none."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise GapError(f"{path}: {error.strerror or error}; give what `{WRITES}` wrote") from None
    except ValueError as error:
        raise GapError(f"{path}: cannot be read as JSON ({error})") from None
    found = document.get("joints") if isinstance(document, dict) else None
    if not isinstance(found, dict):
        found = {document.get("joint", ""): document} if isinstance(document, dict) else {}
    out = {
        str(joint): own["fitted"]
        for joint, own in found.items()
        if isinstance(own, dict) and isinstance(own.get("fitted"), dict)
    }
    if not out:
        raise GapError(f"{path} holds no fitted twin; `{WRITES}` does")
    return out


def predict(model: Mapping[str, Any], log: Log) -> Prediction:
    """Apply a fitted twin to another log; raises GapError if the model is none of ours."""
    try:
        values = {str(k): float(v) for k, v in model["values"].items()}
        unit, effort_unit = str(model["unit"]), str(model["effort_unit"])
        others = Others.from_json(model)
    except (KeyError, TypeError, ValueError, AttributeError):
        raise GapError(f"this is no fitted twin; it is written by `{WRITES}`") from None
    if unit != log.unit:
        raise GapError(f"{log.name}: positions in {log.unit}, but the twin is fitted in {unit}")
    c = clean(log)
    values.setdefault("command_weight", 1.0)
    p = np.array([values.get(n, 0.0) for n in kernel.NAMES])
    out = {"position": math.nan, "free_motion": math.nan, "effort": math.nan, "following": math.nan}
    if c.command is not None:
        out["position"] = _rms(followed(c, p, others) - c.position, c)
        out["following"] = _rms(c.command - c.position, c)
    if c.effort is not None and effort_unit == log.effort_unit:
        field = others.field(p, series_of(c), c.t.size)
        moved = Readings.of(c).moved(p)
        every = max(2, round(HORIZON / c.dt))
        need, free = moved.compared(field, c.effort, (every, 0))
        out["effort"] = _rms(need - c.effort, c)
        out["free_motion"] = _rms(free - c.q, c)
    return Prediction(log.name, log.joint, **out, unit=unit, effort_unit=log.effort_unit)


def predict_all(
    known: Mapping[str, Mapping[str, Any]], logs: Mapping[str, Sequence[Log]]
) -> tuple[list[Prediction], list[str]]:
    """Predictions of all logs whose joint is known, and why the others say nothing.

    Raises GapError with the first reason if none is left.
    """
    made: list[Prediction] = []
    problems: list[str] = []
    for joint, own in logs.items():
        for log in own if joint in known else ():
            try:
                made.append(predict(known[joint], log))
            except GapError as error:
                problems.append(str(error))
    if not made:
        raise GapError(problems[0] if problems else "no log to predict")
    return made, problems


def followed(c: Clean, p: Array, others: Others) -> Array:
    """Position (n,) that follows from the command alone, from the first measured state on; where
    gravity follows other joints, these are as measured.
    """
    assert c.command is not None
    u = kernel.delayed(c.t, c.command, c.dt, p, (c.t - c.t[0]) / max(float(np.ptp(c.t)), 1e-9))
    slope, field = np.gradient(u, c.dt), others.field(p, series_of(c), c.t.size)
    start = float(c.q[0]), float(c.v[0]), float(c.gathered[0])
    p = p.copy()
    p[kernel.MID] = c.middle
    return np.asarray(kernel.forward(u, slope, c.dt, *start, p, field)[0])


def _rms(error: Array, c: Clean) -> float:
    kept = error[c.valid & np.isfinite(error)]
    return float(np.sqrt(np.mean(kept**2))) if kept.size else math.nan
