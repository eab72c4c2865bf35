"""Rows of the comparison from what a bag holds: the same definitions as the live monitor's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from pianobot_ros.cell.motion.geometry import keyboard
from pianobot_ros.cell.recordings.contact_radius import at_contact, planned_radius, played_together
from pianobot_ros.cell.recordings.keystroke import (
    Keystroke,
    NoteEvent,
    keystroke_error,
    keystrokes_from_midi,
)
from pianobot_ros.cell.recordings.recording import Recording, Strike
from pianobot_ros.piano.view.tape.tape import CELLS, StrikeRow

__all__ = ["strike_rows"]

EARLY = 0.05  # s by which a note may come before its window


def strike_rows(recording: Recording) -> list[StrikeRow]:
    """One row for each announced strike, in order of time."""

    strokes = {
        cell: keystrokes_from_midi(_of(recording.notes, cell), keyboard().midi) for cell in CELLS
    }
    rows = []
    announced = [(s.start, s.finger, s.note) for s in recording.strikes]
    for number, strike in enumerate(recording.strikes):
        found: dict[str, Keystroke | None] = {}
        chord = played_together(announced, strike.start, strike.note)
        radius = planned_radius(strike.note, chord)
        for cell in CELLS:
            stroke = _first(strokes[cell], strike)
            if stroke is not None:
                peak = _peak(recording, cell, strike)
                stroke = replace(stroke.with_note_length(strike.note_length), peak_force=peak)
                stroke = at_contact(stroke, radius)
            found[cell] = stroke
        real, sim = found["real"], found["sim"]
        err = float("nan")
        if real is not None and sim is not None and not recording.spoilt(strike):
            err = keystroke_error(sim, real)
        rows.append(
            StrikeRow(
                strike.end,
                strike.start,
                number,
                strike.note,
                strike.condition,
                real,
                sim,
                float(err),
            )
        )
    return rows


def _of(notes: Mapping[str, Sequence[NoteEvent]], cell: str) -> Sequence[NoteEvent]:
    return notes.get(cell, ())


def _first(strokes: Sequence[Keystroke], strike: Strike) -> Keystroke | None:
    inside = (
        s
        for s in strokes
        if s.note == strike.note and strike.start - EARLY <= s.onset <= strike.end
    )
    return next(inside, None)


def _peak(recording: Recording, cell: str, strike: Strike) -> float:
    force = recording.signals.get(f"{cell}/fsr.force")
    if force is None or recording.fsr_note != strike.note:
        return float("nan")
    inside = force.between(strike.start, strike.end).value
    return float(inside.max()) if len(inside) else float("nan")
