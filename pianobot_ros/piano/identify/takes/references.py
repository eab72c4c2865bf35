"""What the twin is to sound like: a bag of the real cell, or a standard MIDI file played with
nominal wrist motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pianobot_ros.bags.reading.read import read_bag
from pianobot_ros.cell.errors import RecordingError, ScoreError
from pianobot_ros.cell.motion.geometry import keyboard
from pianobot_ros.cell.recordings.keystroke import Keystroke, velocity_from_midi
from pianobot_ros.cell.recordings.recording import Recording, TimeSeries
from pianobot_ros.cell.score import load_score, onset_delay, plan_score
from pianobot_ros.cell.score.midi_file import MidiNote, midi_notes
from pianobot_ros.piano.identify.takes.take import Take, make_take, takes_from_recording
from pianobot_ros.piano.twin.reduced.splicing import open_session

__all__ = [
    "is_midi",
    "midi_keystrokes",
    "takes_from_midi",
    "takes_from_reference",
    "takes_from_references",
]

MIDI_SUFFIXES = (".mid", ".midi", ".smf")
LEVEL = 2.5e3  # Pa
NOT_SAID = (0, 64)  # release velocities that files carry when nobody measured one


def takes_from_references(
    references: Sequence[str | Path], pressure: float | None = None
) -> list[Take]:
    """The takes of several references, one after the other; with ``pressure`` (Pa) only those
    within 2.5 kPa of it.

    Raises :class:`RecordingError` where none has that pressure.
    """
    takes = [take for reference in references for take in takes_from_reference(reference)]
    if pressure is None:
        return takes
    chosen = [t for t in takes if abs(t.strike.pressure - pressure) <= LEVEL]
    if not chosen:
        levels = ", ".join(f"{p / 1e3:.0f}" for p in sorted({t.strike.pressure for t in takes}))
        raise RecordingError(
            f"no strike at {pressure / 1e3:g} kPa; there are strikes at {levels} kPa"
        )
    return chosen


def takes_from_reference(
    reference: str | Path, cancelled: Callable[[], bool] | None = None
) -> list[Take]:
    """The takes of a bag directory or a standard MIDI file. ``cancelled`` is asked while a bag is
    read.

    Raises :class:`RecordingError` or :class:`ScoreError` in one line for anything else;
    :class:`CancelledError`.
    """
    path = Path(reference)
    if is_midi(path):
        return takes_from_midi(path)
    if path.suffix.lower() in (".yaml", ".yml", ".csv"):
        raise RecordingError(
            f"{path} is no reference: it does not say how the keys sounded; give a standard MIDI"
            " file (.mid) or a bag"
        )
    return takes_from_recording(read_bag(path, cancelled))


def is_midi(reference: str | Path) -> bool:
    """Whether a reference is a MIDI file: a wish, not something measured."""
    return Path(reference).suffix.lower() in MIDI_SUFFIXES


def takes_from_midi(path: str | Path, *, transpose: int = 0, tempo: float = 1.0) -> list[Take]:
    """Takes of a MIDI file: the wrist moves as the conductor would move it, after the nominal
    servo; the references are the file's own velocities and lengths. Release velocity counts only
    where the file holds one.

    Raises :class:`ScoreError` for a file that cannot be played.
    """
    score = load_score(path, transpose=transpose, tempo=tempo)
    plan = plan_score(score)
    recording = Recording(plan.signals(), strikes=list(plan.strikes), source=str(path))
    session = open_session(recording)
    assert session.wrist is not None
    nominal = np.column_stack([np.interp(plan.time, session.time, x) for x in session.wrist.T])
    recording.signals["real/wrist/state.position"] = TimeSeries(plan.time, nominal, "m")
    asked = midi_keystrokes(path, transpose, tempo)
    midi = keyboard().midi
    takes = []
    marks = iter(plan.strikes)
    for strike in score.strikes:
        for _ in strike.notes:
            mark = next(marks)
            near = [k for k in asked if k.note == mark.note and abs(k.onset - strike.onset) < 0.05]
            # The file's time axis is moved to the plan's.
            onset = mark.start + onset_delay(strike.motion, strike.notes[0])
            heard = [replace(k, onset=onset + k.onset - strike.onset) for k in near[:1]]
            if heard and (take := make_take(session, mark, heard, midi)) is not None:
                takes.append(take)
    if not takes:
        raise ScoreError(f"{path}: none of its notes can be compared with what the hand plays")
    return takes


def midi_keystrokes(path: str | Path, transpose: int = 0, tempo: float = 1.0) -> list[Keystroke]:
    """The notes of a standard MIDI file as keystrokes; V_rel is NaN where the file does not hold
    it.

    Raises :class:`ScoreError` for a file that cannot be read.
    """
    return [_keystroke(n, transpose) for n in midi_notes(Path(path), tempo)]


def _keystroke(note: MidiNote, transpose: int) -> Keystroke:
    midi = keyboard().midi
    released = note.released
    v_rel = float("nan")
    if released is not None and released not in NOT_SAID:
        v_rel = velocity_from_midi(released, midi)
    v_pre = velocity_from_midi(note.velocity, midi)
    return Keystroke(note.note + transpose, note.start, v_pre, v_rel, note.end - note.start)
