"""Err of Eq. 5 on strikes that were not fitted, before and after adopting a verdict.

The gap weighs every signal by its floor and splices measured ones in, so it may shrink while the
notes that the whole twin plays get worse. Eq. 5 asks for the notes alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.motion.geometry import keyboard
from pianobot_ros.cell.recordings.keystroke import Keystroke, keystroke_error, velocity_from_midi
from pianobot_ros.gap import Block, Diagnosis, Measure, Offer
from pianobot_ros.gap.explain.offer import change
from pianobot_ros.gap.floor.measure import drawn_together
from pianobot_ros.gap.problem.types import Array
from pianobot_ros.piano.gap.simulation.description import StrikeBlock
from pianobot_ros.piano.gap.simulation.piano_twin import PianoTwin

__all__ = ["err_held_out", "with_err"]


def with_err(found: Diagnosis, twin: PianoTwin, seed: int = 0) -> Diagnosis:
    """The diagnosis, whose offer has the measure "err" beside the gap where it can be simulated."""
    try:
        measure = err_held_out(found.offer, twin, seed)
    except (PianobotError, ArithmeticError, ValueError):  # an unstable model, a damaged wrist
        return found
    if measure is None:
        return found
    measures = {**found.offer.measures, "err": measure}
    return replace(found, offer=replace(found.offer, measures=measures))


def err_held_out(offer: Offer, twin: PianoTwin, seed: int = 0) -> Measure | None:
    """Mean Err (a fraction) over the strikes that sounded on both cells, with the twin as it was
    and with what is offered, each strike by the values fitted without it; None where
    nothing is offered or fewer than two strikes can be compared.
    """
    own = {b.name: b for b in twin.blocks}
    errors: list[list[float]] = []
    conditions: list[str] = []
    names: list[str] = []
    for fold in offer.folds:
        blocks = [own[n] for n in fold.blocks]
        before = twin.whole_notes(blocks, {}, ())
        after = twin.whole_notes(blocks, fold.values, offer.effects)
        for block, first, second in zip(blocks, before, after, strict=True):
            real = _keystroke(block, block.events)
            pair = [keystroke_error(_keystroke(block, e), real) for e in (first, second)]
            if np.all(np.isfinite(pair)):
                errors.append(pair)
                conditions.append(block.condition)
                names.append(block.name)
    if len(errors) < 2:
        return None
    table = np.array(errors)

    def both(times: Array) -> tuple[Array, Array]:
        first, second = (times @ table / times.sum(1, keepdims=True)).T
        return first, second

    return change(both, drawn_together(conditions, names), seed)


def _keystroke(block: Block, events: Mapping[str, float]) -> Keystroke:
    """What the instrument says of a note, in its own steps; NaN for what did not happen."""
    assert isinstance(block, StrikeBlock)
    midi, hold = keyboard().midi, events.get("note.hold", np.nan)

    def speed(name: str) -> float:
        velocity = events.get(name, np.nan)
        return velocity_from_midi(round(velocity), midi) if np.isfinite(velocity) else np.nan

    stroke = Keystroke(
        block.data.mark.note, 0.0, speed("note.velocity"), speed("note.release"), hold
    )
    return stroke.with_note_length(block.data.mark.note_length)
