"""Takes: strikes of a recording, each with the twin's model ready to play it and the keystroke that
it gave.

The wrist's motion is taken as measured, so that what is left to find is the hand's passive
properties ("fixed wrist control", III-B of "Data-driven Simulation Framework").
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import RecordingError
from pianobot_ros.cell.motion.geometry import Midi, keyboard, pivot_radius
from pianobot_ros.cell.recordings.contact_radius import at_contact, contact_radius
from pianobot_ros.cell.recordings.keystroke import Keystroke, keystrokes_from_midi
from pianobot_ros.cell.recordings.recording import Recording, Strike
from pianobot_ros.piano.twin.reduced.find_strikes import find_strikes
from pianobot_ros.piano.twin.reduced.splicing import Session, open_session
from pianobot_ros.piano.twin.reduced.strike_model import (
    StrikeInput,
    StrikeModel,
    Stroke,
    key_strokes,
    strike_model,
)

__all__ = ["Take", "make_take", "takes_from_recording", "with_sensors"]


BEFORE_SOUND = 0.08  # s between touch and note-on in a slow strike
OVERLAP = (
    0.3  # of the shorter window: neighbouring windows may share their margins, strikes may not
)
LATE = 0.15  # s by which a note may lie outside the window that its strike announced
PAPER_NOTE_LENGTH = 2.5  # s: "the total length of one individual key strike was 2.5 s" (V-B)


@dataclass(frozen=True)
class Take:
    """One strike: ``given`` the measured motion, ``reference`` the keystroke to be reproduced
    (None: the key did not sound).

    ``stiffness`` of ``given`` is what the calibration says; :meth:`stroke` replaces it. On the grid
    of ``given``, empty if not measured: ``pressure`` (n,) Pa, the vacuum of the striking finger;
    ``angle`` (n,) rad and ``force`` (n,) N of the struck key. ``radius`` m is r of Eq. 2 by the
    wrist's measured pose; the speeds of ``reference`` are those that the instrument tells.
    """

    strike: Strike
    model: StrikeModel
    given: StrikeInput
    reference: Keystroke | None
    midi: Midi
    pressure: Array = field(default_factory=lambda: np.zeros(0))
    angle: Array = field(default_factory=lambda: np.zeros(0))
    force: Array = field(default_factory=lambda: np.zeros(0))
    radius: float = float("nan")

    def pressure_in_contact(self) -> Array:
        """Measured vacuum (m,) Pa from shortly before the key sounds until it is let go; NaN if
        unknown.
        """
        if not self.pressure.size or self.reference is None:
            return np.full(1, np.nan)
        time, onset = self.given.time, self.reference.onset
        during = (time > onset - BEFORE_SOUND) & (time < onset + self.reference.t_hold)
        return self.pressure[during] if during.any() else np.full(1, np.nan)

    def at_contact(self, found: Keystroke) -> Keystroke:
        """A keystroke of this strike with V of Eq. 2 where the finger is, not where the
        instrument's curve is given.
        """
        return at_contact(found, self.radius)

    def stroke(
        self, stiffness: float | None = None, values: dict[str, float] | None = None
    ) -> Stroke:
        """The twin's stroke with joint ``stiffness`` (N m/rad; None: as calibrated) and other
        ``values`` of the model.
        """
        given = self.given
        if stiffness is not None:
            given = replace(given, stiffness=np.full(len(given.position), stiffness))
        return self.model.strike(given, values)

    def keystroke(self, stroke: Stroke, midi: Midi | None = None) -> Keystroke | None:
        """The keystroke of a stroke, with T_idle; None where the key does not sound or does not
        come back.
        """
        found = [
            k
            for k in key_strokes(
                stroke, self.strike.note, pivot_radius(self.strike.note), midi or self.midi
            )
            if np.isfinite(k.t_hold)
        ]
        return found[0].with_note_length(self.note_length) if found else None

    @property
    def note_length(self) -> float:
        """T_N of Eq. 2, s: as announced, else the paper's."""
        announced = self.strike.note_length
        return announced if np.isfinite(announced) and announced > 0 else PAPER_NOTE_LENGTH


def takes_from_recording(recording: Recording, cell: str = "real") -> list[Take]:
    """The strikes of a recording as takes. Raises :class:`RecordingError` where strikes or notes
    are missing.
    """
    if cell not in recording.notes:
        raise RecordingError(
            f"{recording.source}: /{cell}/midi is not in this recording: the notes are what is"
            " compared"
        )
    session = open_session(recording)
    midi = keyboard().midi
    notes = keystrokes_from_midi(recording.notes[cell], midi)
    strikes = find_strikes(session)
    _refuse(recording, strikes, cell)
    takes = [
        with_sensors(take, recording, cell)
        for s in strikes
        if (take := make_take(session, s, notes, midi))
    ]
    if not takes:
        raise RecordingError(
            f"{recording.source}: no strike with a measured motion of the wrist: record"
            " /real/wrist/state"
        )
    if not any(take.reference for take in takes):
        raise RecordingError(
            f"{recording.source}: no strike sounded its key: strike deeper or harder"
        )
    return takes


def _refuse(recording: Recording, strikes: Sequence[Strike], cell: str) -> None:
    """Raise :class:`RecordingError` for a clock that jumps back, strikes that overlap, and notes
    without a release.
    """
    source = recording.source or "recording"
    for warning in recording.warnings:
        if "jumps back" in warning:
            raise RecordingError(
                f"{source}: {warning}: record again, or cut the bag before the jump"
            )
    last: dict[int, Strike] = {}
    for strike in sorted(strikes, key=lambda s: s.start):
        before = last.get(strike.note)
        if before is not None and before.end - strike.start > OVERLAP * min(
            before.end - before.start, strike.end - strike.start
        ):
            raise RecordingError(
                f"{source}: strikes {before.index} and {strike.index} of note {strike.note} overlap"
                f" at {strike.start:.2f} s: leave the key time to come back between them"
            )
        last[strike.note] = strike
        events = [
            e
            for e in recording.notes[cell]
            if e.note == strike.note and strike.start - LATE <= e.time <= strike.end + LATE
        ]
        begun = next((e for e in events if e.on and e.velocity > 0), None)
        after = [
            e
            for e in recording.notes[cell]
            if e.note == strike.note and begun and e.time > begun.time
        ]
        if begun is not None and not any(not e.on or e.velocity == 0 for e in after[:1]):
            raise RecordingError(
                f"{source}: note {strike.note} at {begun.time:.2f} s has no release: keep recording"
                " until the key is back up"
            )


def with_sensors(take: Take, recording: Recording, cell: str = "real") -> Take:
    """The take with key angle and force where the struck key carries the sensors."""
    note, grid = take.strike.note, take.given.time

    def measured(name: str) -> Array:
        signal = recording.signals.get(f"{cell}/{name}")
        if signal is None:
            return np.zeros(0)
        part = signal.between(grid[0] - 0.05, grid[-1] + 0.05)
        good = np.isfinite(part.value)
        time = part.time[good]
        whole = time.size > 20 and time[0] < grid[0] + 0.05 and time[-1] > grid[-1] - 0.1
        return np.interp(grid, time, part.value[good]) if whole else np.zeros(0)

    return replace(
        take,
        angle=measured(f"key_angle.{note}"),
        force=measured("fsr.force") if recording.fsr_note == note else np.zeros(0),
    )


def make_take(
    session: Session, strike: Strike, notes: Sequence[Keystroke], midi: Midi
) -> Take | None:
    """The take of one strike, its reference taken from ``notes``; None where the wrist was not
    measured.
    """
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
    given = model.input(
        time, wrist, rotation, 0.0 if pressure is None else pressure, strike.start, strike.end
    )
    own = [
        k
        for k in notes
        if k.note == strike.note and strike.start - LATE <= k.onset <= strike.end + LATE
    ]
    take = Take(
        strike,
        model,
        given,
        None,
        midi,
        np.zeros(0) if pressure is None else pressure,
        radius=contact_radius(strike.finger, np.mean(wrist, axis=0), rotation),
    )
    return replace(take, reference=own[0].with_note_length(take.note_length) if own else None)
