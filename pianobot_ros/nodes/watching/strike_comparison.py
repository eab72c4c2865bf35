"""One strike of both cells, compared: what a GapReport says of keystroke and signals."""

from __future__ import annotations

import numpy as np
from pianobot_msgs.msg import Keystroke, KeystrokeGap, SignalGap, StrikeMark

from pianobot_ros.cell.messages.columns import (
    Place,
    angle_place,
    force_place,
    vacuum_place,
    wrist_place,
)
from pianobot_ros.cell.motion.geometry import keyboard
from pianobot_ros.cell.recordings import keystroke as strokes
from pianobot_ros.cell.recordings.compare import Repeats, compare_signals
from pianobot_ros.cell.recordings.contact_radius import at_contact
from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.session.marks import Marks
from pianobot_ros.nodes.session.notes import EARLY, Listener
from pianobot_ros.nodes.watching.cell_streams import CELLS, CellStreams

__all__ = ["StrikeComparison", "warm_up"]


class StrikeComparison:
    """Compares announced strikes.

    Args:
        streams: the signals of both cells.
        notes: the notes of both cells.
        weights: of dynamics and articulation in Err (Eq. 5).
    """

    def __init__(self, streams: CellStreams, notes: Listener, weights: tuple[float, float]) -> None:
        self._streams, self._notes, self._weights = streams, notes, weights
        self._announced = Marks()
        self._repeats = Repeats()

    def announce(self, mark: StrikeMark) -> None:
        """A strike to come: says where on the key the finger lands."""
        self._announced.add(mark)

    def stroke(self, cell: str, mark: StrikeMark) -> strokes.Keystroke | None:
        """The first complete keystroke of the mark's note that begins in its window."""
        start, end = common.seconds(mark.header.stamp) - EARLY, common.seconds(mark.end)
        events = [e for e in self._notes.events[cell] if e.note == mark.note and e.time >= start]
        found = [s for s in strokes.keystrokes_from_midi(events, keyboard().midi) if s.onset <= end]
        return found[0].with_note_length(mark.note_length) if found else None

    def awaited(self, cell: str, mark: StrikeMark) -> bool:
        """Whether the mark's note may still come: notes come in order, so not after a later one."""
        start, end = common.seconds(mark.header.stamp), common.seconds(mark.end)
        if self.stroke(cell, mark) is not None:
            return False
        events = self._notes.events[cell]
        later = bool(events) and events[-1].time > end
        return not later or self._notes.sounded(cell, mark.note, start, end)

    def keystrokes(self, mark: StrikeMark) -> KeystrokeGap:
        """The keystroke on each cell, and Err between them where both were heard."""
        real, sim = (self.stroke(cell, mark) for cell in CELLS)
        gap = KeystrokeGap(note=mark.note, condition=mark.condition, err=float("nan"))
        gap.real_missing, gap.sim_missing = real is None, sim is None
        gap.real, gap.sim = (
            self._message(stroke, cell, mark) for stroke, cell in ((real, "real"), (sim, "sim"))
        )
        if real is not None and sim is not None:
            gap.err = float(strokes.keystroke_error(sim, real, self._weights))
        return gap

    def _message(self, stroke: strokes.Keystroke | None, cell: str, mark: StrikeMark) -> Keystroke:
        nan = float("nan")
        message = Keystroke(
            note=mark.note, v_pre=nan, v_rel=nan, t_hold=nan, t_idle=nan, peak_force=nan, radius=nan
        )
        if stroke is not None:
            midi = keyboard().midi
            message.onset = common.time_msg(round(1e9 * stroke.onset))
            message.header.stamp = common.time_msg(round(1e9 * (stroke.onset + stroke.t_hold)))
            here = at_contact(stroke, self._announced.of(mark))
            message.v_pre, message.v_rel, message.radius = here.v_pre, here.v_rel, here.radius
            message.t_hold, message.t_idle = stroke.t_hold, stroke.t_idle
            message.velocity_pre = strokes.midi_velocity(stroke.v_pre, midi)
            message.velocity_rel = strokes.midi_velocity(stroke.v_rel, midi)
        start, end = common.seconds(mark.header.stamp), common.seconds(mark.end)
        if self._streams.senses(mark.note):
            times, force = self._streams.window(f"{cell}/fsr", force_place, start, end)
            inside = (times >= start) & (times <= end)
            if inside.any():
                message.peak_force = float(force[inside].max())
        return message

    def signals(self, mark: StrikeMark) -> list[SignalGap]:
        """Lag, RMS and floor of each signal that both cells gave in the mark's window."""
        wanted: list[tuple[str, str, str, Place]] = [
            ("wrist/state", "z", "m", wrist_place(2)),
            ("vacuum/state", mark.finger, "Pa", vacuum_place(mark.finger)),
            ("key_angle", str(mark.note), "rad", angle_place(mark.note)),
        ]
        if self._streams.senses(mark.note):
            wanted.append(("fsr", "force", "N", force_place))
        start, end = common.seconds(mark.header.stamp), common.seconds(mark.end)
        gaps = []
        for topic, part, unit, place in wanted:
            real, sim = (
                self._streams.window(f"{cell}/{topic}", place, start, end) for cell in CELLS
            )
            found = compare_signals(real, sim, start, end)
            if found is None:
                continue
            compared, trace = found
            name = f"{topic}.{part}"
            floor, count = self._repeats.add(name, f"{mark.condition} {mark.note}", trace)
            gaps.append(
                SignalGap(
                    signal=name,
                    unit=unit,
                    lag=compared.lag,
                    rms=compared.rms,
                    rms_aligned=compared.rms_aligned,
                    floor=floor,
                    strikes=count,
                )
            )
        return gaps


def warm_up() -> None:
    """Load what the first comparison would load."""
    keyboard()
    time = np.arange(0.0, 1.0, 0.01)
    compare_signals((time, np.sin(9 * time)), (time, np.cos(9 * time)), 0.1, 0.9)
    Repeats().add("", "", time)
