"""Takes: strikes of a recording, each with the twin's model ready to play it and the keystroke that it gave.

The wrist's motion is taken as measured, so that what is left to find is the hand's passive properties ("fixed wrist control",
III-B of soft-hand-piano-simulator.txt).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pianobot_ros.cell.errors import RecordingError
from pianobot_ros.cell.geometry import Midi, keyboard, pivot_radius
from pianobot_ros.cell.keystroke import Keystroke, keystrokes_from_midi
from pianobot_ros.cell.recording import Recording, Strike
from pianobot_ros.twin.find_strikes import find_strikes
from pianobot_ros.twin.session import Session, open_session
from pianobot_ros.twin.strike import StrikeInput, StrikeModel, Stroke, key_strokes, strike_model

__all__ = ["Take", "takes_from_recording"]

LATE = 0.15  # s by which a note may lie outside the window that its strike announced
PAPER_NOTE_LENGTH = 2.5  # s: "the total length of one individual key strike was 2.5 s" (V-B)


@dataclass(frozen=True)
class Take:
    """One strike: ``given`` the measured motion, ``reference`` the keystroke to be reproduced (None: the key did not sound).

    ``stiffness`` of ``given`` is what the calibration says; :meth:`stroke` replaces it.
    """

    strike: Strike
    model: StrikeModel
    given: StrikeInput
    reference: Keystroke | None
    midi: Midi

    @property
    def radius(self) -> float:
        """r of Eq. 2, m."""
        return pivot_radius(self.strike.note)

    def stroke(self, stiffness: float | None = None, values: dict[str, float] | None = None) -> Stroke:
        """The twin's stroke with joint ``stiffness`` (N m/rad; None: as calibrated) and other ``values`` of the model."""
        given = self.given
        if stiffness is not None:
            given = replace(given, stiffness=np.full(len(given.position), stiffness))
        return self.model.strike(given, values)

    def keystroke(self, stroke: Stroke, midi: Midi | None = None) -> Keystroke | None:
        """The keystroke of a stroke, with T_idle; None where the key does not sound or does not come back."""
        found = [
            k for k in key_strokes(stroke, self.strike.note, self.radius, midi or self.midi) if np.isfinite(k.t_hold)
        ]
        return found[0].with_note_length(self.note_length) if found else None

    @property
    def note_length(self) -> float:
        """T_N of Eq. 2, s: as announced, else the paper's."""
        announced = self.strike.note_length
        return announced if np.isfinite(announced) and announced > 0 else PAPER_NOTE_LENGTH


def takes_from_recording(recording: Recording, cell: str = "real") -> list[Take]:
    """The strikes of a recording as takes. Raises :class:`RecordingError` where strikes or notes are missing."""
    if cell not in recording.notes:
        raise RecordingError(
            f"{recording.source}: /{cell}/midi is not in this recording: the notes are what is compared"
        )
    session = open_session(recording)
    midi = keyboard().midi
    notes = keystrokes_from_midi(recording.notes[cell], midi)
    takes = [take for s in find_strikes(session) if (take := _take(session, s, notes, midi))]
    if not takes:
        raise RecordingError(
            f"{recording.source}: no strike with a measured motion of the wrist: record /real/wrist/state"
        )
    if not any(take.reference for take in takes):
        raise RecordingError(f"{recording.source}: no strike sounded its key: strike deeper or harder")
    return takes


def _take(session: Session, strike: Strike, notes: Sequence[Keystroke], midi: Midi) -> Take | None:
    motion = session.wrist_between(strike.start, strike.end)
    if motion is None:
        return None
    time, wrist = motion
    rotation = np.zeros(3)
    for name in ("real/wrist/state.rotation", "command/wrist.rotation"):
        if name in session.recording.signals and len(
            part := session.recording.signals[name].between(strike.start, strike.end).value
        ):
            rotation = part.mean(axis=0)
            break
    pressure = session.pressure_between(strike.finger, strike.start, strike.end)
    model = strike_model(strike.finger, strike.note)
    given = model.input(time, wrist, rotation, 0.0 if pressure is None else pressure, strike.start, strike.end)
    own = [k for k in notes if k.note == strike.note and strike.start - LATE <= k.onset <= strike.end + LATE]
    take = Take(strike, model, given, None, midi)
    return replace(take, reference=own[0].with_note_length(take.note_length) if own else None)
