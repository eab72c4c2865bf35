"""``gap_monitor``: compares the real and the simulated cell live, strike by strike.

Follows both cells' streams as raw bytes and decodes only the window of each strike once it is over; publishes one
GapReport on ``/gap/live`` for each announced strike.
"""

from __future__ import annotations

import struct
import sys
import time
from collections import deque
from collections.abc import Mapping, Sequence
from itertools import takewhile
from typing import Any

import numpy as np
from pianobot_msgs.msg import (
    GapReport,
    KeyAngle,
    KeyForce,
    Keystroke,
    KeystrokeGap,
    MidiEvent,
    SignalGap,
    StrikeMark,
    VacuumState,
    WristState,
)
from rclpy.serialization import deserialize_message

from pianobot_ros.cell import keystroke as strokes
from pianobot_ros.cell.compare import Repeats, compare_signals
from pianobot_ros.cell.geometry import keyboard
from pianobot_ros.nodes import common
from pianobot_ros.nodes.common import Health, HealthLevel
from pianobot_ros.nodes.polled import Beat, PolledSubscription, stream_qos
from pianobot_ros.nodes.wire import Array, Place, angle_place, columns, force_place, vacuum_place, wrist_place

__all__ = ["GapMonitor", "main"]

CELLS = ("real", "sim")
STREAMS = {"wrist/state": WristState, "vacuum/state": VacuumState, "fsr": KeyForce, "key_angle": KeyAngle}
EVENTS = 200  # notes or strikes of one topic that may come between two looks
KEPT = 15.0  # s of streams kept; the longest window that can be compared
EARLY = 0.05  # s by which a note may come before its window
PATIENCE = 0.5  # s after the window's end after which the comparison is made with what is there
ALIVE = 0.2  # s; a stream that was silent for longer is not waited for
SOON = 0.06  # s before a window's end from which on the streams are looked at more often


class GapMonitor(common.PianoNode):
    """The node."""

    def __init__(self, **options: Any) -> None:
        super().__init__("gap_monitor", **options)
        self._slow = common.declare(
            self, "poll_period", 0.05, "s between two looks at the streams", low=0.005, high=0.2
        )
        self._quick = common.declare(
            self, "end_period", 0.005, "s between two looks when a strike's window ends", low=0.002, high=0.1
        )
        self._weights = (
            common.declare(
                self, "lambda1", strokes.PAPER_LAMBDA[0], "weight of dynamics in Err (Eq. 5)", low=0.0, high=1.0
            ),
            common.declare(
                self, "lambda2", strokes.PAPER_LAMBDA[1], "weight of articulation in Err", low=0.0, high=1.0
            ),
        )
        self._streams = {
            f"{cell}/{name}": PolledSubscription(self, kind, f"/{cell}/{name}", stream_qos(500))
            for cell in CELLS
            for name, kind in STREAMS.items()
        }
        self._kept: dict[str, deque[tuple[float, bytes]]] = {name: deque() for name in self._streams}
        self._events: dict[str, deque[strokes.NoteEvent]] = {cell: deque(maxlen=2000) for cell in CELLS}
        events = stream_qos(EVENTS, reliable=True)
        self._notes = {cell: PolledSubscription(self, MidiEvent, f"/{cell}/midi", events) for cell in CELLS}
        self._marks = PolledSubscription(self, StrikeMark, "/command/strike", events)
        self._report = self.create_publisher(GapReport, "/gap/live", common.EVENT_QOS)
        self._waiting: list[StrikeMark] = []
        self._repeats = Repeats()
        self._errors: list[float] = []
        self._latencies: deque[float] = deque(maxlen=1000)
        self._count = 0
        self._fsr_note: int | None = None
        self._warm_up()
        self._beat = Beat(self, self._poll, self._slow, "streams")
        self._beat.start()

    def _warm_up(self) -> None:
        """Load what the first comparison would load."""
        keyboard()
        time_ = np.arange(0.0, 1.0, 0.01)
        compare_signals((time_, np.sin(9 * time_)), (time_, np.cos(9 * time_)), 0.1, 0.9)
        Repeats().add("", "", time_)

    def diagnose(self) -> Mapping[str, Health]:
        """How many strikes were compared, how quickly, and which streams are silent."""
        silent = [name for name, kept in self._kept.items() if not kept]
        latest = float(np.quantile(self._latencies, 0.99)) if self._latencies else 0.0
        values: dict[str, float | int | str] = {"strikes": self._count, "latency_p99_ms": 1e3 * latest}
        values |= {"err_mean": float(np.mean(self._errors))} if self._errors else {}
        values |= {"silent": ", ".join(silent)} if silent else {}
        return {"comparison": Health(HealthLevel.OK, f"{self._count} strikes compared", 0.0, values)}

    def shut_down(self) -> None:
        """End the looking."""
        self._beat.close()

    # What arrives. All of it on the thread that looks for it, so that a strike's end waits for nothing else of the node.

    def _take_note(self, cell: str, message: MidiEvent) -> None:
        kind = message.status & 0xF0
        if kind in (MidiEvent.NOTE_ON, MidiEvent.NOTE_OFF):
            on = kind == MidiEvent.NOTE_ON and message.velocity > 0
            event = strokes.NoteEvent(common.seconds(message.header.stamp), on, message.note, message.velocity)
            self._events[cell].append(event)

    def _poll(self) -> None:
        now = time.time()
        self._waiting += [deserialize_message(data, StrikeMark) for data, _ in self._marks.take()]
        for cell, notes in self._notes.items():
            for data, _ in notes.take():
                self._take_note(cell, deserialize_message(data, MidiEvent))
        for name, stream in self._streams.items():
            kept = self._kept[name]
            kept.extend((sent * 1e-9, data) for data, sent in stream.take())
            while kept and kept[0][0] < now - KEPT:
                kept.popleft()
        due = [m for m in self._waiting if self._over(m, now)]
        for mark in due:
            self._waiting.remove(mark)
            self._compare(mark)
        ending = any(common.seconds(m.end) < now + SOON for m in self._waiting)
        self._beat.period = self._quick if ending else self._slow

    def _over(self, mark: StrikeMark, now: float) -> bool:
        """Whether all of the strike is there: every living stream has passed the window's end, and every note begun in it has
        ended."""
        end = common.seconds(mark.end)
        if now < end:
            return False
        if now >= end + PATIENCE:
            return True
        newest = [kept[-1] for kept in self._kept.values() if kept and kept[-1][0] > now - ALIVE]
        if any(_stamp(data) < end for _, data in newest):
            return False
        return all(self._stroke(cell, mark) is not None or not self._began(cell, mark) for cell in CELLS)

    def _began(self, cell: str, mark: StrikeMark) -> bool:
        start, end = common.seconds(mark.header.stamp) - EARLY, common.seconds(mark.end)
        return any(e.on and e.note == mark.note and start <= e.time <= end for e in self._events[cell])

    # The comparison.

    def _compare(self, mark: StrikeMark) -> None:
        report = GapReport(strike=self._count)
        self._count += 1
        report.keystrokes = [self._keystrokes(mark)]
        report.signals = self._signals(mark)
        if not np.isnan(err := report.keystrokes[0].err):
            self._errors.append(err)
        report.err_mean = float(np.mean(self._errors)) if self._errors else float("nan")
        now = time.time_ns()
        report.latency = now * 1e-9 - common.seconds(mark.end)
        report.header.stamp = common.time_msg(now)
        self._latencies.append(report.latency)
        self._report.publish(report)

    def _stroke(self, cell: str, mark: StrikeMark) -> strokes.Keystroke | None:
        """The first complete keystroke of the mark's note that begins in its window."""
        start, end = common.seconds(mark.header.stamp) - EARLY, common.seconds(mark.end)
        events = [e for e in self._events[cell] if e.note == mark.note and e.time >= start]
        found = [s for s in strokes.keystrokes_from_midi(events, keyboard().midi) if s.onset <= end]
        return found[0].with_note_length(mark.note_length) if found else None

    def _keystrokes(self, mark: StrikeMark) -> KeystrokeGap:
        real, sim = (self._stroke(cell, mark) for cell in CELLS)
        gap = KeystrokeGap(note=mark.note, condition=mark.condition, err=float("nan"))
        gap.real_missing, gap.sim_missing = real is None, sim is None
        gap.real, gap.sim = (self._message(stroke, cell, mark) for stroke, cell in ((real, "real"), (sim, "sim")))
        if real is not None and sim is not None:
            gap.err = float(strokes.keystroke_error(sim, real, self._weights))
        return gap

    def _message(self, stroke: strokes.Keystroke | None, cell: str, mark: StrikeMark) -> Keystroke:
        nan = float("nan")
        message = Keystroke(note=mark.note, v_pre=nan, v_rel=nan, t_hold=nan, t_idle=nan, peak_force=nan)
        if stroke is not None:
            midi = keyboard().midi
            message.onset = common.time_msg(round(1e9 * stroke.onset))
            message.header.stamp = common.time_msg(round(1e9 * (stroke.onset + stroke.t_hold)))
            message.v_pre, message.v_rel = stroke.v_pre, stroke.v_rel
            message.t_hold, message.t_idle = stroke.t_hold, stroke.t_idle
            message.velocity_pre = strokes.midi_velocity(stroke.v_pre, midi)
            message.velocity_rel = strokes.midi_velocity(stroke.v_rel, midi)
        start, end = common.seconds(mark.header.stamp), common.seconds(mark.end)
        if self._senses(mark.note):
            times, force = self._window(f"{cell}/fsr", force_place, start, end)
            inside = (times >= start) & (times <= end)
            if inside.any():
                message.peak_force = float(force[inside].max())
        return message

    def _senses(self, note: int) -> bool:
        """Whether the force sensor is on this key."""
        if self._fsr_note is None:
            for cell in CELLS:
                if kept := self._kept[f"{cell}/fsr"]:
                    self._fsr_note = int(deserialize_message(kept[-1][1], KeyForce).note)
                    break
        return self._fsr_note == note

    def _signals(self, mark: StrikeMark) -> list[SignalGap]:
        wanted: list[tuple[str, str, str, Place]] = [
            ("wrist/state", "z", "m", wrist_place(2)),
            ("vacuum/state", mark.finger, "Pa", vacuum_place(mark.finger)),
            ("key_angle", str(mark.note), "rad", angle_place(mark.note)),
        ]
        if self._senses(mark.note):
            wanted.append(("fsr", "force", "N", force_place))
        start, end = common.seconds(mark.header.stamp), common.seconds(mark.end)
        gaps = []
        for topic, part, unit, place in wanted:
            real, sim = (self._window(f"{cell}/{topic}", place, start, end) for cell in CELLS)
            found = compare_signals(real, sim, start, end)
            if found is None:
                continue
            compared, trace = found
            name = f"{topic}.{part}"
            floor, count = self._repeats.add(name, f"{mark.condition} {mark.note}", trace)
            gaps.append(
                SignalGap(
                    signal=name, unit=unit, lag=compared.lag, rms=compared.rms, rms_aligned=compared.rms_aligned,
                    floor=floor, strikes=count,
                )
            )  # fmt: skip
        return gaps

    def _window(self, name: str, place: Place, start: float, end: float) -> tuple[Array, Array]:
        kept = takewhile(lambda item: item[0] >= start - 0.1, reversed(self._kept[name]))
        data = [message for sent, message in kept if sent <= end + PATIENCE]
        return columns(data[::-1], place)


def _stamp(data: bytes) -> float:
    """Stamp of a serialized message, s since the epoch."""
    seconds, nanoseconds = struct.unpack_from("<iI", data, 4)
    return float(seconds + 1e-9 * nanoseconds)


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    return common.run(GapMonitor, arguments, pace=common.PACE - 1)


if __name__ == "__main__":
    sys.exit(main())
