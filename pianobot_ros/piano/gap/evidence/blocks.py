"""Recordings as blocks for the diagnosis: one block a strike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pianobot_ros.cell.errors import RecordingError
from pianobot_ros.cell.motion.geometry import FINGERS, keyboard
from pianobot_ros.cell.motion.strike_motion import StrikeMotion
from pianobot_ros.cell.recordings.keystroke import NoteEvent
from pianobot_ros.cell.recordings.recording import Recording, Strike, TimeSeries
from pianobot_ros.gap import Block, Signal, departures
from pianobot_ros.piano.gap.evidence.mend import Losses, played, told_whole, whole
from pianobot_ros.piano.gap.evidence.mend import sound as mended
from pianobot_ros.piano.gap.evidence.session_clocks import set_right
from pianobot_ros.piano.gap.evidence.strike_data import (
    BEFORE,
    PATH,
    StrikeData,
    quiet,
    strike_data,
)
from pianobot_ros.piano.twin.reduced.find_strikes import find_strikes
from pianobot_ros.piano.twin.reduced.splicing import Session, open_session
from pianobot_ros.piano.twin.reduced.strike_model import Stroke, key_strokes

__all__ = ["DRIVEN", "blocks_of", "prepare"]


SPACING = 0.004  # s between the samples of fast signals that are compared
EARLIER = 1.0  # s before the strike from which the pressure is compared
SLOW_PAUSE = 0.3  # s between samples of a pressure, from which it says nothing about a strike
DRIVEN = {"note": "", "speed": "m/s", "depth": "m", "hold": "s", "pressure": "Pa"}
"""Units of those attributes of a strike that say how to play it."""


def prepare(
    recordings: Sequence[Recording], strikes: int = 0
) -> tuple[list[Block], dict[str, StrikeData], list[Session], list[str]]:
    """Blocks, what the twin knows about each, sessions and warnings. At most ``strikes`` blocks,
    spread evenly (0: all).
    """
    sessions = [open_session(mended(set_right(r)), i) for i, r in enumerate(recordings)]
    data: dict[str, StrikeData] = {}
    blocks: list[Block] = []
    tried = 0
    for session in sessions:
        losses = Losses()
        wanted = find_strikes(session)
        if strikes and len(wanted) * len(sessions) > strikes:
            keep = np.unique(
                np.linspace(0, len(wanted) - 1, max(1, strikes // len(sessions)))
                .round()
                .astype(int)
            )
            wanted = [wanted[i] for i in keep]
        for mark in wanted:
            name = (
                f"{session.index + 1}.{mark.index}" if len(sessions) > 1 else f"strike {mark.index}"
            )
            while name in data:
                name += "'"
            made = _made(session, mark, name, losses)
            if made is not None:
                data[name], block = made
                blocks.append(block)
        session.warnings += losses.said(len(wanted))
        tried += len(wanted)
    warnings = [w for s in sessions for w in dict.fromkeys(s.warnings)]
    if not blocks:
        raise RecordingError(_nothing(recordings, sessions, tried, warnings))
    return _with_scatter(blocks), data, sessions, warnings


def _nothing(
    recordings: Sequence[Recording], sessions: Sequence[Session], tried: int, warnings: list[str]
) -> str:
    """Why not one of the ``tried`` strikes can be used: what to record is said where it was not."""
    name = recordings[0].source or "recording"
    if tried and all(s.wrist is not None for s in sessions) and warnings:
        return f"{name}: not one of {tried} strikes can be used: {'; '.join(warnings)}"
    return (
        f"{name}: during none of its strikes were wrist and note known: record /command/wrist (or"
        " /real/wrist/state) together with /command/strike" + "".join(f"; {w}" for w in warnings)
    )


def blocks_of(recording: Recording) -> list[Block]:
    """The blocks of one recording."""
    return prepare([recording])[0]


def _made(
    session: Session, mark: Strike, name: str, losses: Losses
) -> tuple[StrikeData, Block] | None:
    """A strike's data and block; None, and noted, where it says nothing about the cell."""
    if session.recording.spoilt(mark):
        losses.add(mark.index, "commands were refused or obeyed late by the real cell")
        return None
    signals = session.recording.signals
    wrist = (signals.get("command/wrist.position"), signals.get("real/wrist/state.position"))
    if not played(*wrist, mark.start, mark.end):
        losses.add(mark.index, "the arm did not play the strike")
        return None
    try:
        found = strike_data(session, mark, name, losses)
        return None if found is None else (found, _block(found, losses))
    except (ArithmeticError, LookupError, ValueError) as error:  # LinAlgError is a ValueError
        losses.add(mark.index, f"damaged ({type(error).__name__}: {error})")
        return None


def _block(data: StrikeData, losses: Losses) -> Block:
    session, mark = data.session, data.mark
    signals = session.recording.signals
    outputs: dict[str, Signal] = {}
    inputs: dict[str, Signal] = {}
    wrist = signals.get("real/wrist/state.position")
    if wrist is not None and session.wrist is not None and data.given is not None:
        part = wrist.between(data.start, data.end)
        if told_whole(signals.get("command/wrist.position"), data.start, data.end):
            outputs["wrist.z"] = Signal(part.time, part.value[:, 2], "m")
        else:
            losses.add(mark.index, "commands of the wrist are missing")
        cut = session.slice(data.start, data.end)
        inputs["command.z"] = Signal(session.time[cut], session.wrist[cut, 2], "m")
    vacuum = signals.get("real/vacuum/state.measured")
    if vacuum is not None and session.setpoint is not None:
        column = FINGERS.index(mark.finger)
        part = vacuum.between(mark.start - EARLIER, data.end)
        good = np.isfinite(part.value[:, column])
        kept = TimeSeries(part.time[good], part.value[good, column], "Pa")
        if whole(kept, mark.start, data.end, SLOW_PAUSE, 8):
            outputs["pressure"] = Signal(kept.time, kept.value, "Pa")
        else:
            losses.add(mark.index, "pressure not recorded throughout")
    if data.reading is not None:
        outputs["force"] = _thinned(signals["real/fsr.force"], data)
    if data.angle is not None:
        outputs["angle"] = _thinned(signals[f"real/key_angle.{mark.note}"], data)
    return Block(
        data.name,
        _condition(mark),
        inputs,
        outputs,
        _events(data),
        _phases(data),
        {
            "speed": mark.speed,
            "depth": mark.depth,
            "hold": mark.hold,
            "pressure": mark.pressure,
            "note": float(mark.note),
            "finger": float(FINGERS.index(mark.finger)),
            "time": data.start,
        },
        _history(data),
        DRIVEN,
    )


def _history(data: StrikeData) -> str:
    """Vacuum of the striking finger before it last changed, and how long before the strike it
    did.
    """
    session = data.session
    if session.setpoint is None:
        return ""
    past = session.setpoint[
        : np.searchsorted(session.time, data.mark.start), FINGERS.index(data.mark.finger)
    ]
    changes = np.flatnonzero(np.abs(np.diff(past)) > PATH / 2)
    if not changes.size:
        return ""
    before = past[changes[-1]]
    ago = data.mark.start - session.time[changes[-1] + 1]
    return f"from {round(before / PATH)}" + (f" {ago:.1f} s before" if ago < EARLIER else "")


def _thinned(samples: TimeSeries, data: StrikeData) -> Signal:
    part = samples.between(data.start, data.end)
    every = max(1, round(SPACING / max(float(np.median(np.diff(part.time))), 1e-6)))
    return Signal(part.time[::every], part.value[::every], part.unit)


def _condition(mark: Strike) -> str:
    where = f"{mark.finger} {mark.note}"
    if mark.condition:
        return f"{mark.condition} ({where})" if where not in mark.condition else mark.condition
    return mark.motion


def _notes(data: StrikeData) -> tuple[list[NoteEvent], list[NoteEvent]]:
    """Note-ons and note-offs of the struck key that belong to this strike."""
    late = data.end + 0.25
    later = [
        s.start
        for s in data.session.recording.strikes
        if s.note == data.mark.note and s.start > data.mark.start + 1e-6
    ]
    if later:
        late = min(late, max(min(later), data.end))
    events = [
        e
        for e in data.session.recording.notes.get("real", [])
        if e.note == data.mark.note and data.start <= e.time <= late
    ]
    return [e for e in events if e.on and e.velocity > 0], [
        e for e in events if not (e.on and e.velocity > 0)
    ]


def _events(data: StrikeData) -> dict[str, float]:
    if "real" not in data.session.recording.notes:
        return {}
    on, off = _notes(data)
    out = {"note.count": float(len(on))}
    if not on:
        return out
    out["note.onset"] = on[0].time - data.start
    out["note.velocity"] = float(on[0].velocity)
    after = [e for e in off if e.time > on[0].time and (len(on) < 2 or e.time <= on[1].time)]
    if after:
        out["note.hold"] = after[0].time - on[0].time
        out["note.release"] = float(after[0].velocity)
    reference = _reference(data)
    if np.isfinite(reference):
        out["note.delay"] = on[0].time - reference
    return out


def _reference(data: StrikeData) -> float:
    """The moment of the strike to which the note-on belongs, s: the measured angle passes the
    nominal trigger, or the nominal key does under the measured force (its error is the same for all
    repeats, so only the scatter is used).
    """
    midi = keyboard().midi
    if data.angle is not None and data.rate is not None:
        stroke = Stroke(data.start, data.angle, data.rate, np.zeros(0), np.zeros(0))
    elif data.reading is not None:
        stroke = data.model.drive(data.start, quiet(data.reading), data.lever)
    else:
        return float("nan")
    found = key_strokes(stroke, data.mark.note, data.model.key.radius, midi)
    return found[0].onset if found else float("nan")


def _with_scatter(blocks: list[Block]) -> list[Block]:
    """Add ``note.scatter``: how far a strike's note-on delay is from its repeats' (needs three of
    them), s.
    """
    groups: dict[str, list[Block]] = {}
    for b in blocks:
        if "note.delay" in b.events:
            groups.setdefault(b.condition, []).append(b)
    apart = {
        b.name: float(x)
        for g in groups.values()
        if len(g) >= 3
        for b, x in zip(g, departures(np.array([b.events["note.delay"] for b in g])), strict=True)
    }
    out = []
    for b in blocks:
        events = {k: v for k, v in b.events.items() if k != "note.delay"}
        velocities = {x.events.get("note.release") for x in blocks} - {None}
        if (
            len(velocities) < 2
        ):  # a keyboard that does not measure release velocity sends a constant
            events.pop("note.release", None)
        if b.name in apart:
            events["note.scatter"] = apart[b.name]
        out.append(replace(b, events=events))
    return out


def _phases(data: StrikeData) -> dict[str, tuple[float, float]]:
    """approach, press, bottom, hold, release by the wrist's height and the nominal moment of
    contact.
    """
    grid = data.grid
    z = data.given.position[:, 2] if data.given is not None else None
    if z is None:
        mark = data.mark
        motion = StrikeMotion(max(mark.speed, 0.01), max(mark.depth, 1e-3), max(mark.hold, 0.0))
        z = motion.height(grid - data.start - BEFORE)
    low, high = float(z.min()), float(max(z[0], z[-1]))
    deep = np.flatnonzero(z <= low + 0.03 * (high - low))
    down, up = float(grid[deep[0]]), float(grid[deep[-1]])
    force = data.nominal.force if data.nominal is not None else np.zeros(grid.size)
    touched = np.flatnonzero(force > 0.02)
    contact = float(grid[touched[0]]) if touched.size else down
    contact = min(contact, down)
    settled = min(down + 0.06, up)
    return {
        "approach": (float(grid[0]), contact),
        "press": (contact, down),
        "bottom": (down, settled),
        "hold": (settled, up),
        "release": (up, float(grid[-1])),
    }
