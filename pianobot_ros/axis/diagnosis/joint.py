"""From logs of one joint to a verdict."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pianobot_ros.axis.commissioning.around.neighbours import with_neighbours
from pianobot_ros.axis.commissioning.combinations import usual
from pianobot_ros.axis.commissioning.sizes import with_weight
from pianobot_ros.axis.diagnosis.unsure_reference import within_reference
from pianobot_ros.axis.log import Log
from pianobot_ros.axis.signals.cleaning import Clean, clean
from pianobot_ros.axis.signals.lateness import lateness
from pianobot_ros.axis.signals.segment import MOST_SAMPLES, blocks_of
from pianobot_ros.axis.signals.session import in_session
from pianobot_ros.axis.twin.description import COMMISSIONED, INEXACT, LUMPED, drowned
from pianobot_ros.axis.twin.experiments import candidates
from pianobot_ros.axis.twin.fitted import fitted
from pianobot_ros.axis.twin.servo_axis import ServoAxis
from pianobot_ros.axis.twin.since import Since
from pianobot_ros.gap import Block, Calibration, Diagnosis, GapError, Options, diagnose
from pianobot_ros.gap.diagnosis import Estimate, Hypothesis
from pianobot_ros.gap.problem.budget import BLOCKS
from pianobot_ros.gap.problem.types import Array, Effect, Parameter

__all__ = ["OPTIONS", "Finding", "diagnose_joint", "diagnose_logs", "prepared"]

OPTIONS = Options(
    tolerance=0.02, timing_tolerance=0.1, max_effects=3, calibration=Calibration(hidden=8.0)
)
"""On development joints refitted parameters hide as many effects as in the piano cell
(docs/diagnosis-method.md, *Calibration*)."""
EDGE = 1e-3
"""Share of a parameter's range within which a fitted value is on its bound."""
EXTRAS = {"integral": "integral action", "inertia_feedforward": "inertia fed forward"}
"""What a position loop may have beyond a plain one, by its parameter."""
FEWEST_BLOCKS = 100
"""Simulated blocks without which no diagnosis is begun."""
SHIFTED = 0.03
"""Share of the travel by which a joint rests off its command before that is said."""
FAR = 4.0
"""Prior deviations from which a fitted value is said to be doubtful."""


@dataclass(frozen=True)
class Finding:
    """A joint's diagnosis, and the twin with its fitted values (see `fitted.py`)."""

    joint: str
    diagnosis: Diagnosis
    fitted: Mapping[str, Any]
    notes: list[str] = field(default_factory=list)

    def to_json(self) -> dict[str, Any]:
        """The diagnosis' document with rivals, notes and the fitted twin; plain JSON types."""
        document = self.diagnosis.to_json()
        document["warnings"] = [*document["warnings"], *self.notes]
        document["rivals"] = [rival(h) for h in self.diagnosis.hypotheses]
        return {"joint": self.joint, **document, "fitted": dict(self.fitted)}


def rival(h: Hypothesis) -> dict[str, Any]:
    """A hypothesis with its own values."""
    return {
        "name": h.name,
        "effects": list(h.effects),
        "probability": h.probability,
        "gap": h.gap if math.isfinite(h.gap) else None,
        "values": dict(h.values),
    }


def diagnose_logs(logs: Sequence[Log], **how: Any) -> Diagnosis:
    """The diagnosis of `diagnose_joint`."""
    return diagnose_joint(logs, **how).diagnosis


def diagnose_joint(
    logs: Sequence[Log],
    *,
    nominal: Mapping[str, float] | None = None,
    known: Mapping[str, Mapping[str, float]] | None = None,
    reference: Sequence[Log] = (),
    seed: int = 0,
    budget: int = BLOCKS,
    jobs: int = 1,
    options: Options | None = None,
) -> Finding:
    """Diagnose logs of one joint against the axis twin.

    `nominal` are believed parameter values (`COMMISSIONED` in `description.py`); without them the
    twin is commissioned from the logs. `known` are effects the twin already has: {name: {parameter:
    value}}. With `reference` logs of the same joint (another day, no payload) the twin is first
    identified on those, and the question becomes what changed since (see `since.py`). Dry friction
    and gravity are then the twin's own, by regression, as is any effect that the verdict on the
    reference names.
    """
    if not logs:
        raise GapError("give at least one log")
    options = options or OPTIONS
    trust = 0.2
    notes: list[str] = []
    before: Diagnosis | None = None
    since: Since | None = None
    same: Clean | None = None
    if reference:
        was, blocks, _ = prepared(reference, nominal, known)
        had = {**usual(was.joint), **(known or {})}
        was, blocks, _ = prepared(reference, nominal, had)
        asked = _asked(was, options)
        before = diagnose(was, blocks, seed=seed, budget=budget // 2, jobs=jobs, options=asked)
        nominal = {n: p.value for n, p in before.parameters.items() if n in COMMISSIONED}
        known = {**_refitted(had, before), **_found(before)}
        trust = INEXACT if was.joint.has("effort") else LUMPED
        budget -= min(int(before.provenance["simulated_blocks"]), budget // 2)
        since = Since(_estimates(before), was.joint.others.arm, _missed(was, blocks, before))
        same = was.joint.logs[0]
        notes.append(f"of the reference: {_said(had, before)}")
    twin, blocks, said = prepared(
        logs, nominal, known, same, anywhere=not reference, trust=trust, since=since
    )
    result = _diagnosed(twin, blocks, options, seed=seed, budget=budget, jobs=jobs)
    if before is not None:
        result = within_reference(result, before)
    elif result.verdict == "unknown" and not nominal and twin.joint.has("command"):
        left = budget - int(result.provenance["simulated_blocks"])
        other = _other_loop(twin, logs, known, options, seed=seed, budget=left, jobs=jobs)
        twin, result, said = other or (twin, result, said)
    seen = (*clipped(twin, result), *late_positions(result), *scaled(result))
    own = (*far_off(twin, result), *seen, *doubtful(twin.effects, result))
    warnings = (*result.warnings, *own, *said, *notes)
    result = replace(result, warnings=warnings)
    return Finding(logs[0].joint, result, fitted(twin, result))


def _diagnosed(twin: ServoAxis, blocks: Sequence[Block], options: Options, **how: Any) -> Diagnosis:
    """The diagnosis with the motions that may be proposed; `how`: seed, budget and jobs."""
    asked = _asked(twin, options)
    return diagnose(twin, blocks, options=asked, experiments=candidates(twin), **how)


def _other_loop(
    first: ServoAxis,
    logs: Sequence[Log],
    known: Mapping[str, Mapping[str, float]] | None,
    options: Options,
    **how: Any,
) -> tuple[ServoAxis, Diagnosis, list[str]] | None:
    """Twin, diagnosis and notes with another structure of the position loop, where an effect
    beside it explains what none explains beside the `first` one; `how`: seed, budget and jobs.

    Whether the controller has integral action or feeds the inertia forward is read from the log
    before any effect is looked for, and a missing effect may decide it: a ringing load looks like
    either. So a loop that has one is tried without, and a plain one with an integrator.
    """
    if how["budget"] < FEWEST_BLOCKS:
        return None
    has = [name for name in EXTRAS if first.joint.nominal.get(name, 0.0) > 0.0]
    twin, blocks, said = prepared(logs, None, known, anywhere=True, plain=bool(has))
    result = _diagnosed(twin, blocks, options, **how)
    if result.verdict != "effect":  # a loop with more to fit hides a ringing load too
        return None
    what = " and ".join(EXTRAS[name] for name in has) or EXTRAS["integral"]
    before, now = ("with", "without") if has else ("without", "with")
    said.append(
        f"with a position loop {before} {what}, which fits the log better before any effect is"
        f" looked for, nothing explains what is left; it is explained by a loop {now} it"
    )
    return twin, result, said


def _asked(twin: ServoAxis, options: Options) -> Options:
    """The options, asking for no effect that these logs cannot tell; if that is all that is asked
    for it is refused.
    """
    there = {e.name for e in twin.effects}
    return replace(options, only=tuple(n for n in options.only if n in there) or options.only)


def far_off(twin: ServoAxis, result: Diagnosis) -> list[str]:
    """Parameters that the data pull far from what was believed of them, or onto a bound."""
    out = []
    for p in twin.parameters:
        value = result.parameters[p.name].value if p.name in result.parameters else p.nominal
        at, low, middle, high = (_scaled(p, x) for x in (value, p.low, p.nominal, p.high))
        span = EDGE * (high - low)
        ends = [b for b in (low, high) if abs(at - b) < span < abs(middle - b)]
        if ends:
            bound = p.low if ends[0] == low else p.high
            out.append(
                f"{p.name} = {value:.3g} {p.unit} is at the end of what is allowed ({bound:.3g}):"
                " a cause may be missing"
            )
        elif abs(at - middle) > FAR * p.sd:
            out.append(
                f"{p.name} = {value:.3g} {p.unit} is {abs(at - middle) / p.sd:.0f} prior deviations"
                f" from {p.nominal:.3g}: a cause may be missing, or --nominal {p.name}=… is wrong"
            )
    return out


def doubtful(library: Sequence[Effect], result: Diagnosis) -> list[str]:
    """Effects that are named though what the twin may be wrong by is as large as they are: their
    intervals hold none of them. Another one that acts alike may be what is there.
    """
    of = {e.name: e for e in library}
    out = []
    for found in result.effects:
        effect = of.get(found.name)
        size = found.parameters.get(effect.magnitude) if effect else None
        if effect is None or size is None or not size.low <= effect.null <= size.high:
            continue
        less = f", which would leave {effect.remainder[0]}" if effect.remainder else ""
        out.append(
            f"{effect.magnitude} = {size.value:.3g} {size.unit} ({size.low:.3g} to {size.high:.3g})"
            f" may be none{less}: something of its kind is seen, but an error of the twin's own, or"
            f" another law, may look like {found.name}"
        )
    return out


def late_positions(result: Diagnosis) -> list[str]:
    """What an effort that leads the position, beside a command that does as well, has as its one
    cause.
    """
    found = {n: e for effect in result.effects for n, e in effect.parameters.items()}
    latency, delay = found.get("sensor_latency"), found.get("command_delay")
    if latency is None or latency.value >= 0.0:
        return []
    by = f"{-1e3 * latency.value:.3g} ms"
    if delay is not None and delay.low <= -latency.low and -latency.high <= delay.high:
        return [
            f"the position alone comes late, by {by}: sensor_latency and command_delay are of one"
            " size, its distance from effort and from command"
        ]
    return [
        f"the position comes {by} after the effort: its sensor is late, or the effort is a command"
        " that the drive carries out so much later"
    ]


def scaled(result: Diagnosis) -> list[str]:
    """What else a payload may be that hangs where the joint's own gravity does, and brings as large
    a share of the inertia: all efforts in another proportion to the torque.
    """
    own = result.parameters
    found = {n: e for effect in result.effects for n, e in effect.parameters.items()}
    if not {"payload_gravity", "payload_angle", "payload_inertia"} <= found.keys():
        return []
    if not {"gravity", "gravity_angle", "inertia"} <= own.keys() or own["gravity"].value <= 0.0:
        return []
    share = found["payload_gravity"].value / own["gravity"].value
    mass, angle = found["payload_inertia"], found["payload_angle"]
    alike = mass.low <= share * own["inertia"].value <= mass.high
    if not alike or not angle.low <= own["gravity_angle"].value <= angle.high:
        return []
    return [
        f"gravity grew by {share:.0%}, where it hung before, and inertia may have grown by as much:"
        " a motor that gives less torque for its effort, or a current that is read too large, looks"
        " the same; that raises friction too, which a mass does not, and a move with a known mass"
        " tells"
    ]


def clipped(twin: ServoAxis, result: Diagnosis) -> list[str]:
    """What a drive gives at most, where a limit of it is named."""
    peak, unit = twin.joint.known.get("peak", 0.0), twin.joint.scales.effort_unit
    values = {n: p.value for e in result.effects for n, p in e.parameters.items()}
    depths = (values[n] for n in ("torque_limit", "speed_limit_depth") if n in values)
    return [f"the drive gives {peak * (1.0 - d):.3g} {unit} at most" for d in depths if peak]


def _scaled(p: Parameter, value: float) -> float:
    """A value on the scale of the parameter's prior."""
    return math.log(max(value, 1e-300)) if p.log else value


def prepared(
    logs: Sequence[Log],
    nominal: Mapping[str, float] | None,
    known: Mapping[str, Mapping[str, float]] | None,
    reference: Clean | None = None,
    anywhere: bool = False,
    **how: Any,
) -> tuple[ServoAxis, list[Block], list[str]]:
    """Twin and blocks of some logs, and what there is to say about how they were read; what other
    joints draw is known from a `reference`, or asked of those `anywhere` in the arm; `how` is the
    twin's. Raises GapError where no log can be used.
    """
    moving, resting = _moving(logs)
    cleaned = in_session(moving)
    if all(c.command is None and c.effort is None for c in cleaned):
        raise GapError(
            "a log with position alone says nothing about a twin: a command or an effort column is"
            " needed (--columns command=HEADER or effort=HEADER)"
        )
    cleaned, drawn = with_neighbours(with_weight(cleaned), reference, anywhere=anywhere)
    used: list[Clean] = []
    blocks: list[Block] = []
    left_out: list[str] = []
    said: list[tuple[str, str]] = []
    for c in cleaned:
        try:
            made, cut = blocks_of(c, max(8, 40 // len(cleaned)), MOST_SAMPLES // len(cleaned))
        except GapError as error:
            left_out.append(str(error))
            continue
        used.append(c)
        blocks += made
        missing = [r for r in ("command", "velocity", "effort") if getattr(c.log, r) is None]
        unseen = f"no {', '.join(missing)} column, so effects that show only there stay unseen"
        texts = (cut, *c.log.notes, *([unseen] if missing else []))
        said += [(c.log.name, text) for text in texts]
    if not used:
        raise GapError(left_out[0])
    late = None if nominal else lateness(used)
    notes = [*resting, *([drawn] if drawn else []), *([late] if late else [])]
    notes += _once([("left out", text) for text in left_out])
    notes += _once(said)
    often = Counter(b.condition for b in blocks)
    repeats = sum(n for n in often.values() if n > 1)
    twin = ServoAxis(used, nominal, known, repeated=2 * repeats > len(blocks), **how)
    if twin.joint.others.contact is not None:
        notes.append(twin.joint.others.contact.said())
    offs = [np.mean(c.position - c.command) for c in used if c.command is not None]
    off = float(np.mean(offs)) if offs and not twin.joint.has("effort") else 0.0
    if abs(off) > SHIFTED * twin.joint.scales.travel:
        notes.append(
            f"the joint rests {off:+.3g} {twin.joint.unit} from where it is sent, on average: a"
            " constant load or a shifted zero, which look alike without a measured effort"
        )
    if drowned(twin.joint):
        notes.append(
            "the noise of effort moves the joint further than its acceleration does, so motion is"
            " not predicted from effort; faster moves, or a quieter effort, would tell more"
        )
    return twin, blocks, notes


def _once(said: Sequence[tuple[str, str]]) -> list[str]:
    """What is said of many logs, pairs of a name and a text, each once; numbers are those of the
    first log.
    """
    kinds: dict[str, list[tuple[str, str]]] = {}
    for name, text in said:
        kinds.setdefault(re.sub(r"\d\S*", "#", text), []).append((name, text))
    out = []
    for (name, text), *others in kinds.values():
        out.append(f"{name}: {text}{f' (and {len(others)} more)' if others else ''}")
    return out


def _moving(logs: Sequence[Log]) -> tuple[list[Clean], list[str]]:
    """Logs that can be used, cleaned, and why the others cannot; raises GapError if none can."""
    out: list[Clean] = []
    problems: list[str] = []
    for log in logs:
        try:
            out.append(clean(log))
        except GapError as error:
            problems.append(str(error))
    if not out:
        raise GapError(problems[0])
    return out, _once([("left out", p) for p in problems])


def _found(before: Diagnosis) -> dict[str, dict[str, float]]:
    """Effects that the verdict on the reference names; what it called unknown is not adopted."""
    return {e.name: {n: p.value for n, p in e.parameters.items()} for e in before.effects}


def _estimates(before: Diagnosis) -> dict[str, Estimate]:
    """The posterior of everything that the twin has after the reference."""
    named = {n: p for e in before.effects for n, p in e.parameters.items()}
    return {**before.parameters, **named}


def _refitted(
    known: Mapping[str, Mapping[str, float]], before: Diagnosis
) -> dict[str, dict[str, float]]:
    """Known effects with the values that the diagnosis of the reference gave them."""
    had = before.parameters
    return {
        name: {n: had[n].value if n in had else v for n, v in own.items()}
        for name, own in known.items()
    }


def _said(had: Mapping[str, Mapping[str, float]], before: Diagnosis) -> str:
    own = f"{', '.join(had)} taken as the twin's own" if had else "no friction, no gravity"
    named = ", ".join(e.name for e in before.effects)
    return f"{own}; verdict {before.verdict}{f' ({named})' if named else ''}"


def _missed(was: ServoAxis, blocks: Sequence[Block], before: Diagnosis) -> dict[str, float]:
    """RMS that the identified twin leaves of each observable of its own reference: what is smaller
    is no change.
    """
    found = _found(before)
    values = {n: p.value for n, p in before.parameters.items()}
    for own in found.values():
        values.update(own)
    squares: dict[str, list[Array]] = {}
    for block, prediction in zip(blocks, was.simulate(blocks, values, tuple(found)), strict=True):
        for o in was.observables:
            if o.signal in block.outputs and o.name in prediction:
                squares.setdefault(o.name, []).append(
                    (np.asarray(prediction[o.name]) - block.outputs[o.signal].y) ** 2
                )
    return {name: float(np.sqrt(np.nanmean(np.concatenate(s)))) for name, s in squares.items()}
