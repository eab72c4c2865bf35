"""Standard MIDI files reduced to what one hand with thumb and middle finger can reach.

Notes within ``CHORD`` s of one another are struck together if thumb and middle finger can stretch
to two of them; every note that is left out is named with the reason. MIDI velocity v becomes the
wrist's peak speed v / velocity_gain, the key speed that gives this velocity on the nominal curve,
bounded by what the arm may do.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from pianobot_ros.cell.errors import ConfigError, ScoreError
from pianobot_ros.cell.motion.geometry import Keyboard, keyboard
from pianobot_ros.cell.motion.limits import WristLimits, wrist_limits
from pianobot_ros.cell.motion.strike_motion import StrikeMotion
from pianobot_ros.cell.motion.wrist_poses import WristPose, wrist_pose
from pianobot_ros.cell.numbers.bounded_files import read_bytes, title
from pianobot_ros.cell.recordings.keystroke import velocity_from_midi
from pianobot_ros.cell.score.plan import travel_time
from pianobot_ros.cell.score.types import (
    Score,
    ScoreStrike,
    check_strikes,
    check_tempo,
    hold_for,
    onset_delay,
)

__all__ = ["MidiNote", "midi_notes", "read_midi", "reduce_notes", "wrist_speed"]

CHORD = 0.03  # s; keys of a chord on a digital piano lie within 30 ms
DEPTH, CLEARANCE, PRESSURE = 0.014, 0.005, -50e3
SLOWEST = 0.05  # m/s: below, the key may stop short of its trigger
MARGIN = 0.9  # of the acceleration limit
LONGEST = 1_000_000  # bytes of a file
LIFT_MARGIN, SHORTEST_HOLD = 0.03, 0.02  # s


@dataclass(frozen=True)
class MidiNote:
    """A note of a file: ``start`` and ``end`` s, note number, velocity, and that of the message
    that ends it, where one does.
    """

    start: float
    end: float
    note: int
    velocity: int
    released: int | None = None

    def __str__(self) -> str:
        return f"note {self.note} at {self.start:.2f} s"


def wrist_speed(
    velocity: int, board: Keyboard | None = None, limits: WristLimits | None = None
) -> float:
    """Peak wrist speed (m/s) for a MIDI velocity."""
    board, limits = board or keyboard(), limits or wrist_limits()
    fastest = limits.fastest(MARGIN * (DEPTH + CLEARANCE))
    return float(np.clip(velocity_from_midi(velocity, board.midi), SLOWEST, fastest))


def midi_notes(path: Path, tempo: float = 1.0) -> list[MidiNote]:
    """The notes of a standard MIDI file by start, percussion left out; one that nothing ends lasts
    until the file does. Raises :class:`ScoreError` for a file that cannot be read.
    """
    now, notes = 0.0, list[MidiNote]()
    sounding: dict[tuple[int, int], MidiNote] = {}  # by channel and note
    for message in _messages(path):
        now += message.time / tempo
        if message.type not in ("note_on", "note_off") or message.channel == 9:
            continue
        key = (message.channel, message.note)
        if (begun := sounding.pop(key, None)) is not None:
            released = message.velocity if message.type == "note_off" else None
            notes.append(replace(begun, end=now, released=released))
        if message.type == "note_on" and message.velocity > 0:
            sounding[key] = MidiNote(now, now, message.note, message.velocity)
    notes += [replace(n, end=now) for n in sounding.values()]
    return sorted(notes, key=lambda n: (n.start, n.note))


def _messages(path: Path) -> list[Any]:
    """The messages of all tracks of a standard MIDI file, each with the s since the one before it
    (`time`). Raises :class:`ScoreError` for a file that cannot be read.
    """
    import mido

    try:
        data = read_bytes(path, LONGEST)
    except ConfigError as error:
        raise ScoreError(str(error)) from error
    try:
        return list(mido.MidiFile(file=BytesIO(data)))
    except Exception as error:  # mido raises whatever its decoders meet
        reason = " ".join(str(error).split())[:200] or "it ends too early"
        raise ScoreError(
            f"{path.name} is not a standard MIDI file that can be read: {reason}"
        ) from error


def read_midi(path: str | Path, *, transpose: int = 0, tempo: float = 1.0) -> Score:
    """The score in a standard MIDI file (percussion left out)."""
    check_tempo(tempo)
    path = Path(path)
    notes = midi_notes(path, tempo)
    check_strikes(len(notes), path.name)
    if not notes:
        raise ScoreError(f"{path.name} holds no notes")
    moved = [replace(n, note=n.note + transpose) for n in notes]
    _on_keyboard(moved, path.name, transpose)
    strikes, left_out = reduce_notes(moved)
    if not strikes:
        raise ScoreError(
            f"{path.name}: none of its {len(notes)} notes can be played: {left_out[0]}"
        )
    return Score(title(path), tuple(strikes), tuple(left_out))


def _on_keyboard(notes: list[MidiNote], name: str, transpose: int) -> None:
    board = keyboard()
    low, high = board.notes[0], board.notes[-1]
    if any(low <= n.note <= high for n in notes):
        return
    pitches = np.array([n.note for n in notes])
    # Whole octaves keep the key; of those that bring most notes onto the keyboard, the smallest.
    shifts = sorted((12 * k for k in range(-10, 11)), key=abs)
    best = max(
        shifts, key=lambda s: int(np.count_nonzero((pitches + s >= low) & (pitches + s <= high)))
    )
    raise ScoreError(
        f"{name}: all {len(notes)} notes ({pitches.min()} to {pitches.max()}) lie off the keyboard"
        f" ({low} to {high}): play it with --transpose {transpose + best}"
    )


def reduce_notes(notes: list[MidiNote]) -> tuple[list[ScoreStrike], list[str]]:
    """Strikes for the notes, and a line for each note left out."""
    board, limits = keyboard(), wrist_limits()
    left_out: list[str] = []
    present = []
    for n in notes:
        if n.note in board.notes:
            present.append(n)
        else:
            left_out.append(
                f"{n}: out of reach, the keyboard has {board.notes[0]} to {board.notes[-1]}"
            )
    strikes: list[ScoreStrike] = []
    free_at, last_pose = -np.inf, None
    chords = _chords(present)
    for i, chord in enumerate(chords):
        playable, pose, reasons = _playable(chord, limits)
        left_out += reasons
        if not playable or pose is None:
            continue
        first = next(iter(playable.values()))
        onset = first.start
        speed = wrist_speed(max(n.velocity for n in playable.values()), board, limits)
        bare = StrikeMotion(speed, DEPTH, 0.0, CLEARANCE)
        begin = onset - onset_delay(bare, first.note, board)
        needed = free_at + (travel_time(last_pose, pose, limits) if last_pose is not None else 0.0)
        if begin < needed - 1e-9:
            left_out += [
                f"{n}: too fast, the hand is there {needed - begin:.2f} s late"
                for n in playable.values()
            ]
            continue
        t_hold = max(n.end for n in playable.values()) - onset
        following = chords[i + 1][0].start if i + 1 < len(chords) else np.inf
        # Lift in time for the next note; what is held too briefly sounds, what is struck too late
        # does not.
        hold = hold_for(bare, first.note, t_hold)
        if i + 1 < len(chords):
            _, next_pose, _ = _playable(chords[i + 1], limits)
            move = travel_time(pose, next_pose, limits) if next_pose is not None else 0.0
            room = following - onset_delay(bare, first.note, board) - LIFT_MARGIN - move - begin
            hold = min(hold, max(room - bare.down_time - bare.up_time, SHORTEST_HOLD))
        motion = StrikeMotion(speed, DEPTH, hold, CLEARANCE)
        fingers = "+".join(f"{f[0]}{n.note}" for f, n in playable.items())
        strikes.append(
            ScoreStrike(
                tuple(playable),
                tuple(n.note for n in playable.values()),
                motion,
                PRESSURE,
                f"{fingers} v{max(n.velocity for n in playable.values())} {t_hold:.2f}s",
                note_length=float(min(following - onset, t_hold + 0.5)),
                onset=onset,
            )
        )
        free_at, last_pose = begin + motion.duration, pose
    return strikes, left_out


def _chords(notes: list[MidiNote]) -> list[list[MidiNote]]:
    chords: list[list[MidiNote]] = []
    for n in notes:
        if chords and n.start - chords[-1][0].start <= CHORD:
            chords[-1].append(n)
        else:
            chords.append([n])
    return chords


def _playable(
    chord: list[MidiNote], limits: WristLimits
) -> tuple[dict[str, MidiNote], WristPose | None, list[str]]:
    """Which notes of a chord are played by which finger: the highest carries the tune, the thumb
    takes what it reaches.
    """
    ordered = sorted({n.note: n for n in chord}.values(), key=lambda n: -n.note)
    top, *others = ordered
    for lower in others:
        targets = {"thumb": lower.note, "middle": top.note}
        try:
            pose = wrist_pose(targets)
        except ScoreError:
            continue
        if limits.refusal(pose.raised(-DEPTH)):
            continue
        rest = [n for n in others if n is not lower]
        reasons = [f"{n}: more than two notes at once" for n in rest]
        return {"middle": top, "thumb": lower}, pose, reasons
    reasons = [
        f"{n}: thumb and middle finger cannot stretch to it together with note {top.note}"
        for n in others
    ]
    pose = wrist_pose({"middle": top.note})
    if reason := limits.refusal(pose.raised(-DEPTH)):
        return {}, None, [*reasons, f"{top}: {reason}"]
    return {"middle": top}, pose, reasons
