"""Recordings as blocks for the diagnosis: one block a strike, and beside it what the twin needs to
simulate that strike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numba import njit

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import RecordingError
from pianobot_ros.cell.motion.geometry import FINGERS, keyboard
from pianobot_ros.cell.motion.strike_motion import StrikeMotion
from pianobot_ros.cell.recordings.contact_radius import planned_radius, played_together
from pianobot_ros.cell.recordings.keystroke import NoteEvent
from pianobot_ros.cell.recordings.recording import Recording, Strike, TimeSeries
from pianobot_ros.gap import Block, Signal, departures
from pianobot_ros.piano.gap.effects.base import recall
from pianobot_ros.piano.gap.effects.filters import play
from pianobot_ros.piano.gap.evidence.mend import Losses, played, told_whole, whole
from pianobot_ros.piano.gap.evidence.mend import sound as mended
from pianobot_ros.piano.gap.evidence.session_clocks import set_right
from pianobot_ros.piano.twin.reduced.find_strikes import find_strikes
from pianobot_ros.piano.twin.reduced.splicing import Session, open_session, smooth_angle
from pianobot_ros.piano.twin.reduced.strike_model import (
    GRID,
    StrikeInput,
    StrikeModel,
    Stroke,
    key_strokes,
    strike_model,
)

__all__ = ["DRIVEN", "StrikeData", "blocks_of", "prepare"]


BEFORE, AFTER = 0.03, 0.12  # s kept before and after the commanded motion
SPACING = 0.004  # s between the samples of fast signals that are compared
PATH = 10e3  # Pa of change after which it no longer matters where a pressure came from
EARLIER = 1.0  # s before the strike from which the pressure is compared
LEFT = 2e-4  # rad: a key that rests deeper than this did not come back
SLOW_PAUSE = 0.3  # s between samples of a pressure, from which it says nothing about a strike
LONGEST = 6.0  # s: a longer strike window is cut
DRIVEN = {"note": "", "speed": "m/s", "depth": "m", "hold": "s", "pressure": "Pa"}
"""Units of those attributes of a strike that say how to play it."""


@dataclass(frozen=True, eq=False)
class StrikeData:
    """One strike for the twin: model, inputs on its grid, and measured signals to splice in (None:
    not measured).
    """

    name: str
    session: Session
    mark: Strike
    start: float
    end: float
    model: StrikeModel
    pressure: Array | float
    side: float
    given: StrikeInput | None = None
    angle: Array | None = None
    rate: Array | None = None
    reading: Array | None = None
    nominal: Stroke | None = None

    @cached_property
    def grid(self) -> Array:
        """Grid of the strike (n,), s."""
        count = max(2, round((self.end - self.start) / GRID) + 1)
        return np.asarray(self.start + GRID * np.arange(count), dtype=np.float64)

    @cached_property
    def lever(self) -> float:
        """Distance (m) from the key's hinge at which the finger presses: a hand that plays a chord
        cannot land at the usual point of every key.
        """
        strikes = [(s.start, s.finger, s.note) for s in self.session.recording.strikes]
        chord = played_together(strikes, self.mark.start, self.mark.note)
        return planned_radius(self.mark.note, chord)

    @cached_property
    def motion(self) -> Stroke | None:
        """The key's motion as measured."""
        if self.angle is None or self.rate is None:
            return None
        return Stroke(
            self.start, self.angle, self.rate, np.zeros_like(self.angle), np.zeros_like(self.angle)
        )

    @cached_property
    def resting(self) -> float:
        """Angle at which the key rests before the strike, rad: 0 unless it was left somewhere
        else.
        """
        if self.angle is None:
            return 0.0
        before = float(np.median(self.angle[: max(2, round(BEFORE / GRID))]))
        return before if before > LEFT else 0.0

    @cached_property
    def push(self) -> Array | None:
        """The measured force without the sensor's noise while nothing touches the key."""
        return None if self.reading is None else quiet(self.reading)

    def input(self, time: Array, wrist: Array) -> StrikeInput:
        """Input of the strike model from another wrist motion (n, 3) at ``time`` (n,)."""
        return self.model.input(
            time,
            wrist,
            rotation_of(self.session, self.start, self.end),
            self.pressure,
            self.start,
            self.end,
        )


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


def rotation_of(session: Session, start: float, end: float) -> Array:
    """Mean rotation vector of the wrist in a window, (3,) rad: measured, else commanded, else
    none.
    """
    for name in ("real/wrist/state.rotation", "command/wrist.rotation"):
        signal = session.recording.signals.get(name)
        if signal is not None:
            part = signal.between(start, end)
            if len(part.time) and np.all(np.isfinite(part.value)):
                return np.asarray(part.value.mean(0))
    return np.zeros(3)


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
        found = _data(session, mark, name, losses)
        return None if found is None else (found, _block(found, losses))
    except (ArithmeticError, LookupError, ValueError) as error:  # LinAlgError is a ValueError
        losses.add(mark.index, f"damaged ({type(error).__name__}: {error})")
        return None


def _data(session: Session, mark: Strike, name: str, losses: Losses) -> StrikeData | None:
    if mark.finger not in FINGERS or mark.note not in keyboard().notes:
        session.warnings.append(
            f"strike {mark.index}: finger '{mark.finger}' on note {mark.note} is not of this cell:"
            " left out"
        )
        return None
    start, end = _window(session, mark)
    model = strike_model(mark.finger, mark.note)
    pressure = session.pressure_between(mark.finger, start, end)
    level: Array | float = mark.pressure if pressure is None else pressure
    recording = session.recording
    data = StrikeData(
        name, session, mark, start, end, model, level, _vacuum_side(session, mark.finger, start)
    )
    motion = _unbroken(session, "real/wrist/state.position", "wrist", mark, start, end, losses)
    moved = session.wrist_between(start, end) if motion is not None else None
    given = data.input(*moved) if moved is not None else None
    if given is None:
        if session.wrist is None:
            return None
        cut = session.slice(start - 0.1, end + 0.1)
        nominal = model.strike(data.input(session.time[cut], session.wrist[cut]))
    else:
        nominal = model.strike(given)
    angle = rate = reading = None
    part = _unbroken(session, f"real/key_angle.{mark.note}", "key angle", mark, start, end, losses)
    if part is not None:
        angle, rate = smooth_angle(part.time, part.value, data.grid)
    if recording.fsr_note in (mark.note, None):
        part = _unbroken(session, "real/fsr.force", "force", mark, start, end, losses)
        if part is not None:
            reading = np.interp(data.grid, part.time, part.value)
    return replace(data, given=given, angle=angle, rate=rate, reading=reading, nominal=nominal)


def _unbroken(
    session: Session,
    name: str,
    what: str,
    mark: Strike,
    start: float,
    end: float,
    losses: Losses,
) -> TimeSeries | None:
    """A fast signal around a strike; None, and noted, where its stream paused."""
    signal = session.recording.signals.get(name)
    if signal is None:
        return None
    if not whole(signal, start, end, fewest=8 if what == "wrist" else 20):
        losses.add(mark.index, f"{what} not recorded throughout")
        return None
    return signal.between(start - 0.05, end + 0.05)


def _vacuum_side(session: Session, finger: str, at: float) -> float:
    """From which side a finger's pressure was reached, -1 (from more vacuum) to 1 (from less); 0
    before it first changed.

    By the measured pressure, else by its setpoint.
    """
    column = FINGERS.index(finger)
    measured = session.recording.signals.get("real/vacuum/state.measured")
    if measured is not None:
        past = measured.value[: np.searchsorted(measured.time, at), column][::10]
    elif session.setpoint is not None:
        past = session.setpoint[: np.searchsorted(session.time, at), column][::100]
    else:
        return 0.0
    past = past[np.isfinite(past)]
    return float(play(past, 2.0 * PATH, recall(None))[-1] - past[-1]) / PATH if past.size else 0.0


def _window(session: Session, mark: Strike) -> tuple[float, float]:
    """The commanded motion within the announced window, with margins."""
    start, end = mark.start, min(mark.end, mark.start + LONGEST)
    command = session.recording.signals.get("command/wrist.position")
    signal = command or session.recording.signals.get("real/wrist/state.position")
    if signal is not None:
        part = signal.between(start, end)
        if len(part.time) > 8:
            z = part.value[:, 2]
            moving = np.flatnonzero(np.abs(np.gradient(z)) > 1e-3 * max(float(np.ptp(z)), 1e-6))
            if moving.size:
                start = max(start - BEFORE, float(part.time[moving[0]]) - BEFORE)
                end = min(end + AFTER, float(part.time[moving[-1]]) + AFTER)
    return float(start), float(max(end, start + 0.1))


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
    return f"from {before / PATH:.0f}" + (f" {ago:.1f} s before" if ago < EARLIER else "")


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


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def quiet(force: Array) -> Array:
    """Force (n,) N without the sensor's noise while nothing touches the key."""
    peak = np.max(force)
    rest = force[np.abs(force) < 0.3 * max(peak, 1e-9)]
    noise = 1.4826 * np.median(np.abs(np.diff(rest))) if rest.size > 10 else 0.0
    touching = np.flatnonzero(force > max(4.0 * noise, 0.01 * peak))
    out = np.zeros_like(force)
    if touching.size:
        low, high = max(touching[0] - 2, 0), touching[-1] + 3
        out[low:high] = force[low:high]
    return out


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
