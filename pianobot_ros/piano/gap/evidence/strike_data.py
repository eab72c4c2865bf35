"""What the twin needs to simulate one recorded strike."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numba import njit

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.motion.geometry import FINGERS, keyboard
from pianobot_ros.cell.recordings.contact_radius import planned_radius, played_together
from pianobot_ros.cell.recordings.recording import Strike, TimeSeries
from pianobot_ros.piano.gap.effects.base import recall
from pianobot_ros.piano.gap.effects.filters import play
from pianobot_ros.piano.gap.evidence.mend import Losses, whole
from pianobot_ros.piano.twin.reduced.splicing import Session, smooth_angle
from pianobot_ros.piano.twin.reduced.strike_model import (
    GRID,
    StrikeInput,
    StrikeModel,
    Stroke,
    strike_model,
)

__all__ = ["BEFORE", "PATH", "StrikeData", "quiet", "strike_data"]

BEFORE, AFTER = 0.03, 0.12  # s kept before and after the commanded motion
PATH = 10e3  # Pa of change after which it no longer matters where a pressure came from
LEFT = 2e-4  # rad: a key that rests deeper than this did not come back
LONGEST = 6.0  # s: a longer strike window is cut


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
            _rotation_of(self.session, self.start, self.end),
            self.pressure,
            self.start,
            self.end,
        )


def strike_data(session: Session, mark: Strike, name: str, losses: Losses) -> StrikeData | None:
    """What is known of an announced strike; None, and noted, where it is none of this cell."""
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


def _rotation_of(session: Session, start: float, end: float) -> Array:
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
