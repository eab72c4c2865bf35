"""What of the blocks can be used: the rest is left out signal by signal or block by block, counted,
and said once.

A recording is seldom whole. A signal without samples, one whose clock stepped, or one that stood
still while its repeats moved says nothing about the robot; a block that the twin cannot simulate
cannot be compared. Neither is a reason to judge nothing.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from pianobot_ros.gap.problem.constants import (
    CLOCK_STEP,
    FEWEST_SAMPLES,
    LARGEST,
    MOST,
    NEGLIGIBLE,
    SMALL,
)
from pianobot_ros.gap.problem.errors import GapError
from pianobot_ros.gap.problem.recordings.spikes import bridged, spiked
from pianobot_ros.gap.problem.types import Array, Block, Observable, Signal, usable

NO_NUMBER = "is no number"
GAPS = "is commanded with samples that are no numbers"
SPIKES = "leaves the range of all its others for a sample or two"
STOPS = "has no samples for a tenth of the block and more"
MEASURES = {
    GAPS: "the twin gets them as they are",
    SPIKES: "bridged there; what is as wrong within that range stays, and may look like a cause",
    STOPS: "give samples that are no numbers there, so that what rests on them is not judged",
}


def sound(
    blocks: Sequence[Block], observables: Iterable[Observable]
) -> tuple[tuple[Block, ...], list[str], set[str]]:
    """The blocks without signals and phases that cannot be used, a warning for every reason, and
    the signals of which readings were taken out.
    """
    units = {o.signal: o.unit for o in observables if o.kind == "series"}
    wanted = sorted(units)
    moving = {name: _moving_conditions(blocks, name) for name in wanted}
    spiky = {name: spiked(blocks, name) for name in wanted}
    count, apart, clocks = (Counter[tuple[str, str]]() for _ in range(3))
    out = []
    for k, block in enumerate(blocks):
        inputs = {n: _numbers(s) for n, s in block.inputs.items()}
        outputs = {n: _numbers(s) for n, s in block.outputs.items()}
        for pair in _no_one_clock(inputs, {n: outputs[n] for n in wanted if n in outputs}):
            clocks[pair] += 1
        for name, s in inputs.items():
            if not (np.isfinite(s.y).all() and np.isfinite(s.t).all()):
                count[name, GAPS] += 1
        for name in [n for n in wanted if n in outputs]:
            if outputs[name].unit and units[name] and outputs[name].unit != units[name]:
                apart[name, outputs[name].unit] += 1
            reason = _fault(outputs[name], block.condition in moving[name])
            if reason:
                del outputs[name]
            elif k in spiky[name]:
                reason, outputs[name] = SPIKES, bridged(outputs[name], spiky[name][k])
            if reason:
                count[name, reason] += 1
            if name in outputs and _stops(outputs[name].t[np.isfinite(outputs[name].t)]):
                count[name, STOPS] += 1
        events = {n: x for n, x in block.events.items() if math.isnan(x) or abs(x) < LARGEST}
        for name in set(block.events) - set(events):
            count[name, NO_NUMBER] += 1
        phases = {n: p for n, p in block.phases.items() if np.all(np.isfinite(p))}
        out.append(replace(block, inputs=inputs, outputs=outputs, events=events, phases=phases))
    said = [
        *(
            f"{name} is in {unit} in {n} of {len(blocks)} blocks and in {units[name]} in the twin:"
            " nothing is converted"
            for (name, unit), n in apart.items()
        ),
        *(
            f"{one} and {other} share hardly any of their time in {n} of {len(blocks)} blocks: are"
            " the stamps of both in seconds, and of one clock?"
            for (one, other), n in clocks.items()
        ),
        *(
            f"{name} {reason} in {n} of {len(blocks)} blocks: "
            + MEASURES.get(reason, "left out there")
            for (name, reason), n in count.items()
        ),
    ]
    return tuple(out), said, {name for name in wanted if spiky[name]}


def _no_one_clock(
    inputs: Mapping[str, Signal], outputs: Mapping[str, Signal]
) -> list[tuple[str, str]]:
    """Each input that hardly shares its time with the longest output, and that output."""
    spans = {n: _span(s) for n, s in (*inputs.items(), *outputs.items())}
    longest = max(outputs, key=lambda n: np.ptp(spans[n]), default="")
    out = []
    for name in inputs if longest else ():
        (a, b), (begin, end) = spans[longest], spans[name]
        if min(b - a, end - begin) > 0.0:
            shared = min(b, end) - max(a, begin)
            out += [(name, longest)] if shared < NEGLIGIBLE * max(b - a, end - begin) else []
    return out


def _span(signal: Signal) -> tuple[float, float]:
    """First and last stamp (s); the same where there are none."""
    t = signal.t[np.isfinite(signal.t)]
    return (float(t.min()), float(t.max())) if t.size else (0.0, 0.0)


def blocks_that(
    simulate: Callable[[Block], object],
    blocks: Sequence[Block],
    observables: Iterable[Observable] = (),
) -> tuple[tuple[Block, ...], str]:
    """The blocks that `simulate` takes one by one, without what of the `observables`' signals
    cannot be used there, and a warning that says what the others fail of and what they lack so.

    Raises GapError if there are none.
    """
    kept, last = [], ""
    lacking = set[str]()
    for block, used in zip(blocks, sound(blocks, observables)[0], strict=True):
        try:
            simulate(used)
        except Exception as error:  # a user's simulator may fail in any way
            last = f"{type(error).__name__}: {error}"
            lacking |= set(block.outputs) - set(used.outputs)
        else:
            kept.append(block)
    if not kept:
        raise GapError(f"the twin cannot simulate any block at its nominal parameters ({last})")
    lost = f"{len(blocks) - len(kept)} of {len(blocks)} blocks"
    if lacking:
        lost += f", some without {', '.join(sorted(lacking))}, which cannot be used there"
    return tuple(kept), f"the twin cannot simulate {lost} ({last}): left out"


def _numbers(signal: Signal) -> Signal:
    """The signal with NaN where it holds no number."""
    with np.errstate(invalid="ignore"):
        good = np.abs(signal.y) < LARGEST
    if good.all():
        return signal
    return Signal(signal.t, np.where(good, signal.y, np.nan), signal.unit)


def _fault(signal: Signal, repeats_move: bool) -> str:
    """Why a signal cannot be used; empty if it can."""
    kept = usable(signal)
    if kept.size < FEWEST_SAMPLES:
        return "has no samples"
    if _stepped(signal.t[np.isfinite(signal.t)]):
        return "has stamps that step back"
    if repeats_move and np.ptp(signal.y[kept]) == 0:
        return "stands still unlike its repeats"
    return ""


def _stops(t: Array) -> bool:
    """Whether stamps (n,) leave a stretch out, far longer than their usual step."""
    step = np.diff(t)
    usual = float(np.median(step)) if step.size else 0.0
    return bool(step.size and np.max(step) > max(SMALL * np.ptp(t), CLOCK_STEP * usual))


def _stepped(t: Array) -> bool:
    step = np.diff(t)
    back = step[step < 0]
    if not back.size:
        return False
    usual = float(np.median(step[step > 0])) if np.any(step > 0) else 0.0
    return bool(back.size > SMALL * step.size or -float(back.min()) > CLOCK_STEP * usual)


def _moving_conditions(blocks: Sequence[Block], name: str) -> frozenset[str]:
    """Conditions in which the signal moves in more than half of the blocks."""
    moves: Mapping[str, list[bool]] = {b.condition: [] for b in blocks}
    for b in blocks:
        if name in b.outputs:
            y = b.outputs[name].y[usable(b.outputs[name])]
            if y.size >= FEWEST_SAMPLES:
                moves[b.condition].append(bool(np.ptp(y) > 0))
    return frozenset(c for c, m in moves.items() if sum(m) > MOST * len(m))
