"""What was found, in lines for a terminal."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from pianobot_ros.axis.diagnosis.joint import Finding
from pianobot_ros.axis.diagnosis.robot import RobotFinding
from pianobot_ros.axis.twin.fitted import Prediction
from pianobot_ros.gap.diagnosis import Estimate

__all__ = ["answer", "predicted", "report_lines"]

RIVALS = 4


def report_lines(found: RobotFinding) -> Iterator[str]:
    """One joint at length; of many, a table and then each at length."""
    if len(found.joints) == 1 and not found.left_out:
        yield from at_length(next(iter(found.joints.values())))
        return
    wide = max(len(n) for n in [*found.joints, *found.left_out])
    for name, own in found.joints.items():
        sure, what = answer(own)
        gap = own.diagnosis.gap
        yield (
            f"{name:<{wide}}  {100 * sure:5.1f} %  {what:<40}"
            f" gap {gap.before:.1f} -> {gap.after:.1f} floors"
        )
    for name, why in found.left_out.items():
        yield f"{name:<{wide}}  left out: {why}"
    for name, own in found.joints.items():
        yield ""
        yield f"{name}:"
        yield from at_length(own)


def answer(own: Finding) -> tuple[float, str]:
    """How sure, and what: the effects of the verdict, or the verdict."""
    found = own.diagnosis
    if found.verdict == "effect":
        names = [e.name for e in found.effects]
        sure = sum(c.probability for c in found.candidates if c.name in names)
        return min(sure, 1.0), " + ".join(names)
    sure = next((c.probability for c in found.candidates if c.name == found.verdict), 0.0)
    return sure, found.verdict


def at_length(own: Finding) -> Iterator[str]:
    """Sentence, candidates, values, rivals with their values, and notes."""
    found = own.diagnosis
    yield found.sentence
    for c in found.candidates[:6]:
        stage = f"  ({c.stage})" if c.stage else ""
        yield f"  {100 * c.probability:5.1f} %  {c.name}{stage}"
    for e in found.effects:
        for name, p in e.parameters.items():
            yield f"  {_value(name, p)}"
    fitted = ", ".join(_value(n, p) for n, p in found.parameters.items())
    alone = " without an effect" if found.verdict == "unknown" else ""
    yield f"  twin's own{alone}: {fitted}"
    leader = {e.name for e in found.effects}
    rivals = [h for h in found.hypotheses if h.effects and set(h.effects) != leader][:RIVALS]
    for h in rivals:
        values = [f"{n} = {v:.4g}" for n, v in h.values.items() if n not in found.parameters]
        yield f"  rival {h.name} ({100 * h.probability:.1f} %): {', '.join(values)}"
    for warning in [*found.warnings, *own.notes]:
        yield f"  note: {warning}"


def _value(name: str, p: Estimate) -> str:
    return f"{name} = {p.value:.4g} ({p.low:.4g} to {p.high:.4g}) {p.unit}".rstrip()


def predicted(made: Sequence[Prediction]) -> Iterator[str]:
    """A line for each log, and the errors pooled over all."""
    for p in made:
        scale, unit = (1e3, "mm") if p.unit == "m" else (1e3, "mrad")
        parts = []
        if math.isfinite(p.position):
            parts.append(
                f"position error {scale * p.position:.2f} {unit} RMS"
                f" (command minus position: {scale * p.following:.2f})"
            )
        if math.isfinite(p.effort):
            parts.append(f"effort error {p.effort:.3g} {p.effort_unit} RMS")
            parts.append(f"free motion {scale * p.free_motion:.2f} {unit} RMS")
        yield f"{p.name}: {'; '.join(parts) or 'nothing to compare'}"
    errors = [p.position for p in made if math.isfinite(p.position)]
    if len(errors) > 1:
        pooled = math.sqrt(sum(e * e for e in errors) / len(errors))
        unit = "mm" if made[0].unit == "m" else "mrad"
        yield f"pooled over {len(errors)}: position error {1e3 * pooled:.2f} {unit} RMS"
