"""From a recording to strikes: where each begins and ends, which finger met which key, and what
belongs together as repeats.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import PianobotError, RecordingError
from pianobot_ros.cell.motion.geometry import fingertip, key_centre, keyboard, strike_point
from pianobot_ros.cell.recordings.recording import Strike
from pianobot_ros.piano.twin.reduced.splicing import Session

__all__ = ["find_strikes"]

TRAVEL = 0.006  # m: smaller movements of the wrist are no strikes
LATE_NOTE = 0.4  # s after the wrist's lowest point in which a note still belongs to the strike


def find_strikes(session: Session) -> list[Strike]:
    """The strikes of a recording: as announced, else found in the commanded (or measured) motion of
    the wrist.

    Raises :class:`RecordingError` if there are none.
    """
    recording = session.recording
    end = float(session.time[-1])
    marks = [
        s
        for s in recording.strikes
        if s.end > s.start and s.start < end - 0.05 and s.end > session.time[0]
    ]
    whole = [s for s in marks if s.end <= end + 0.1]
    if len(whole) < len(marks):
        session.warnings.append("the recording ends within a strike: that strike is left out")
    if whole:
        return whole
    if recording.strikes and not whole:
        raise RecordingError(
            f"{recording.source or 'recording'}: it ends before its first strike does: record"
            " longer"
        )
    found = _segment(session)
    if not found:
        raise RecordingError(
            f"{recording.source or 'recording'}: no strike in it, neither announced on"
            " /command/strike nor as a movement of the wrist down to a key: play a phrase while"
            " recording"
        )
    session.warnings.append(
        "no /command/strike in the recording: strikes were found in the wrist's motion"
    )
    return found


def _segment(session: Session) -> list[Strike]:
    recording = session.recording
    signal = (
        recording.signals.get("command/wrist.position")
        or recording.signals["real/wrist/state.position"]
    )
    turns = recording.signals.get("command/wrist.rotation") or recording.signals.get(
        "real/wrist/state.rotation"
    )
    t, z = signal.time, signal.value[:, 2]
    strikes: list[Strike] = []
    i = 0
    while i < len(t) - 2:
        top = i
        while top + 1 < len(t) and z[top + 1] >= z[top]:
            top += 1
        bottom = top
        while bottom + 1 < len(t) and z[bottom + 1] <= z[bottom]:
            bottom += 1
        rise = bottom
        while rise + 1 < len(t) and z[rise + 1] >= z[rise]:
            rise += 1
        if z[top] - z[bottom] > TRAVEL and z[rise] - z[bottom] > TRAVEL:
            strikes += _strike(
                session,
                len(strikes),
                t,
                signal.value,
                turns.value if turns else None,
                top,
                bottom,
                rise,
            )
            i = rise
        else:
            i = max(bottom, top + 1)
    return strikes


def _strike(
    session: Session,
    number: int,
    t: Array,
    x: Array,
    turns: Array | None,
    top: int,
    bottom: int,
    rise: int,
) -> list[Strike]:
    z = x[:, 2]
    low = z[bottom]
    going = np.flatnonzero(z[top:bottom] > low + 0.98 * (z[top] - low))
    begin = t[top + (going[-1] if going.size else 0)]
    leaving = np.flatnonzero(z[bottom:rise] < low + 0.02 * (z[rise] - low))
    first_low = t[top + int(np.flatnonzero(z[top : bottom + 1] < low + 0.02 * (z[top] - low))[0])]
    last_low = t[bottom + (int(leaving[-1]) if leaving.size else 0)]
    speed = (
        float(np.max(-np.gradient(z[top : bottom + 1], t[top : bottom + 1])))
        if bottom - top > 2
        else 0.05
    )
    rotation = turns[bottom] if turns is not None and len(turns) == len(t) else np.zeros(3)
    finish = min(float(t[rise]), last_low + 1.5 * (first_low - begin) + 0.1)
    played = [
        e
        for e in session.recording.notes.get("real", [])
        if e.on and begin < e.time < last_low + LATE_NOTE
    ]
    places = _fingers_on_keys(x[bottom], rotation, [e.note for e in played])
    out: list[Strike] = []
    for finger, note, depth in places:
        hold = max(0.0, float(last_low - first_low))
        pressure = session.pressure_between(finger, float(begin), float(finish))
        level = float(np.mean(pressure)) if pressure is not None else 0.0
        mark = Strike(
            number + len(out),
            "",
            "",
            finger,
            note,
            float(begin) - 0.02,
            finish + 0.1,
            speed,
            depth,
            hold,
            level,
            float("nan"),
        )
        out.append(replace(mark, condition=mark.motion))
    return out


def _fingers_on_keys(
    wrist: Array, rotation: Array, heard: list[int]
) -> list[tuple[str, int, float]]:
    """Fingers whose resting tip would be below a key's top: (finger, note, depth m); the deepest
    alone unless two notes sound.
    """
    board = keyboard()
    turn = Rotation.from_rotvec(rotation)
    found = []
    for finger in ("thumb", "middle", "index"):
        try:
            tip = wrist + turn.apply(fingertip(finger))
        except PianobotError:
            continue
        note = min(
            board.notes,
            key=lambda n: abs(key_centre(n) - tip[0]) + 0.3 * abs(strike_point(n)[1] - tip[1]),
        )
        depth = float(strike_point(note)[2] - tip[2])
        if depth > 0.002:
            found.append((finger, note, depth))
    found.sort(key=lambda f: -f[2])
    wanted = 2 if len(set(heard)) > 1 else 1
    matching = [f for f in found if f[1] in heard]
    return (matching or found)[:wanted]
