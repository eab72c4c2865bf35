"""The monitor between two hand-made cells whose difference is known exactly."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from pianobot_msgs.msg import (
    GapReport,
    KeyAngle,
    KeyForce,
    MidiEvent,
    StrikeMark,
    VacuumCommand,
    VacuumState,
    WristState,
)
from sensor_msgs.msg import TimeReference

from pianobot_ros.cell.messages.columns import (
    angle_place,
    columns,
    force_place,
    vacuum_place,
    wrist_place,
)
from pianobot_ros.cell.motion.geometry import keyboard
from pianobot_ros.cell.recordings.compare import Repeats, compare_signals, lag_between
from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.session.refused_commands import RefusalPublisher
from pianobot_ros.nodes.watching.gap_monitor import GapMonitor

LENGTH = 0.5  # s, window of a strike
AHEAD = 0.5  # s by which a strike is announced


def shape(t: float) -> float:
    """A strike of 0.3 s in the window."""
    return 0.5 * (1 - float(np.cos(2 * np.pi * np.clip((t - 0.1) / 0.3, 0, 1))))


@pytest.mark.parametrize("shift", [0.0, 0.0123, -0.031])
def test_the_lag_is_found_below_the_spacing(shift: float) -> None:
    t = np.arange(0, 1, 0.002)
    real = np.exp(-(((t - 0.5 - shift) / 0.08) ** 2))
    sim = np.exp(-(((t - 0.5) / 0.08) ** 2))
    assert lag_between(real, sim) == pytest.approx(shift, abs=2e-4)


def test_a_signal_that_rests_has_no_lag_and_a_gap_of_samples_no_comparison() -> None:
    t = np.arange(0, 1, 0.008)
    found = compare_signals((t, 0 * t + 1.0), (t, 0 * t + 3.0), 0.0, 0.9)
    assert found is not None and np.isnan(found[0].lag) and found[0].rms == pytest.approx(2.0)
    hole = (t < 0.3) | (t > 0.6)
    assert compare_signals((t[hole], t[hole]), (t, t), 0.0, 0.9) is None


def test_the_floor_is_the_scatter_of_repeats() -> None:
    random, repeats = np.random.default_rng(0), Repeats()
    assert np.isnan(repeats.add("z", "a", np.zeros(500))[0])
    repeats = Repeats()
    for _ in range(10):
        floor, count = repeats.add("z", "a", np.arange(500) + 0.3 * random.standard_normal(500))
    assert count == 10 and floor == pytest.approx(0.3, rel=0.1)
    assert repeats.add("z", "other", np.zeros(500))[1] == 1


def test_columns_agree_with_the_ordinary_decoder(ros: Any) -> None:
    from rclpy.serialization import serialize_message

    stamp = common.time_msg(1_700_000_000_123_456_789)
    for frame in ("", "base", "a_longer_frame"):
        wrist = WristState()
        wrist.pose.position.z = 0.25
        force = KeyForce(note=64, force=1.5)
        vacuum = VacuumState(
            fingers=["thumb", "index", "middle"], setpoint=[1.0, 2.0, 3.0], measured=[4.0, 5.0, 6.0]
        )
        angle = KeyAngle(notes=[60, 62, 64], angle=[0.1, 0.2, 0.3], velocity=[1.0, 2.0, 3.0])
        for message, place, expected in (
            (wrist, wrist_place(2), 0.25),
            (force, force_place, 1.5),
            (wrist, wrist_place(6), 1.0),
            (vacuum, vacuum_place("middle"), 6.0),
            (vacuum, vacuum_place("index", 0), 2.0),
            (
                VacuumCommand(fingers=["thumb", "index"], pressure=[7.0, 8.0]),
                vacuum_place("index", 0),
                8.0,
            ),
            (angle, angle_place(64), 0.3),
        ):
            message.header.stamp, message.header.frame_id = stamp, frame
            times, values = columns([serialize_message(message)] * 3, place)
            assert values.tolist() == [expected] * 3
            assert times[0] == pytest.approx(1_700_000_000.123456789, abs=1e-6)
        assert len(columns([serialize_message(angle)], angle_place(71))[0]) == 0


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """A monitor that waits for as long as a busy machine takes to bring what was sent."""
    for where, name in (
        ("cell_streams", "PATIENCE"),
        ("cell_streams", "ALIVE"),
        ("gap_monitor", "ARRIVAL"),
    ):
        monkeypatch.setattr(f"pianobot_ros.nodes.watching.{where}.{name}", 60.0)


@pytest.mark.graph
class TestLive:
    # s between a stamp and the moment at which its message had been sent, the least
    sent_after: float

    def play(
        self,
        ros: Any,
        strikes: int,
        lag: float,
        *,
        silent: bool = False,
        late: float = 0.0,
        also: Sequence[Any] = (),
        meanwhile: Callable[[float], None] = lambda begin: None,
    ) -> list[GapReport]:
        """Strikes in real time; the real wrist is ``lag`` later and 1 mm higher, its note 20 units
        louder. Everything arrives ``late`` s after it was measured. ``meanwhile`` is told
        when a strike is to begin; what it publishes comes from ``also``."""
        tester = ros.node("tester")
        monitor = ros.add(GapMonitor(context=ros.context))
        reports = ros.record(GapReport, "/gap/live")
        mark_out = tester.create_publisher(StrikeMark, "/command/strike", common.EVENT_QOS)
        wrist = {
            c: tester.create_publisher(WristState, f"/{c}/wrist/state", common.SENSOR_QOS)
            for c in ("real", "sim")
        }
        force = {
            c: tester.create_publisher(KeyForce, f"/{c}/fsr", common.SENSOR_QOS)
            for c in ("real", "sim")
        }
        midi = {
            c: tester.create_publisher(MidiEvent, f"/{c}/midi", common.EVENT_QOS)
            for c in ("real", "sim")
        }
        everyone = [mark_out, *wrist.values(), *force.values(), *midi.values()]
        ros.matched(*everyone, *also, monitor._report)
        self.sent_after = np.inf
        for index in range(strikes):
            begin = 0.0
            while begin <= time.time():  # held up for so long, it would be said after the strike
                begin = time.time() + AHEAD
                meanwhile(begin)
            mark = StrikeMark(
                index=index, condition="a", finger="middle", note=64, note_length=LENGTH
            )
            mark.header.stamp = common.time_msg(round(1e9 * begin))
            mark.end = common.time_msg(round(1e9 * (begin + LENGTH)))
            mark_out.publish(mark)
            events = (
                []
                if silent
                else [
                    ("sim", 0.2, 144, 50),
                    ("real", 0.21, 144, 70),
                    ("sim", 0.3, 128, 40),
                    ("real", 0.31, 128, 40),
                ]
            )
            due = begin - 0.1
            while due < begin + LENGTH + 0.06 + late:
                now = time.time()
                if now < due:
                    ros.executor.spin_once(timeout_sec=due - now)
                    continue
                measured = due - late  # on the grid, however late this process is itself
                due += 0.005
                stamp = common.time_msg(round(1e9 * measured))
                for cell, delay, offset in (("real", lag, 0.001), ("sim", 0.0, 0.0)):
                    state = WristState()
                    state.header.stamp = stamp
                    state.pose.position.z = 0.2 + offset - 0.02 * shape(measured - begin - delay)
                    wrist[cell].publish(state)
                    pressed = KeyForce(
                        note=64, force=(3.0 if cell == "real" else 2.0) * shape(measured - begin)
                    )
                    pressed.header.stamp = stamp
                    force[cell].publish(pressed)
                self.sent_after = min(self.sent_after, time.time() - measured)
                while events and measured >= begin + events[0][1]:
                    cell, at, status, velocity = events.pop(0)
                    event = MidiEvent(status=status, note=64, velocity=velocity)
                    event.header.stamp = common.time_msg(round(1e9 * (begin + at)))
                    midi[cell].publish(event)
        ros.wait_for(lambda: len(reports) >= strikes, "a report for each strike")
        return reports

    def test_lag_gap_floor_and_err_are_those_that_were_made(self, ros: Any, patient: None) -> None:
        first, second = self.play(ros, strikes=2, lag=0.02)
        assert (first.strike, second.strike) == (0, 1)
        (gap,) = second.keystrokes
        gain = keyboard().midi.velocity_gain
        assert gap.real.v_pre == pytest.approx(70 / gain) and gap.sim.v_pre == pytest.approx(
            50 / gain
        )
        assert gap.real.t_hold == pytest.approx(0.1, abs=1e-6)
        assert gap.real.t_idle == pytest.approx(LENGTH - 0.1, abs=1e-6)
        assert gap.err == pytest.approx(0.8 * 0.5 * 20 / 70, rel=1e-3)
        assert second.err_mean == pytest.approx(gap.err, rel=1e-3)
        assert gap.real.peak_force == pytest.approx(
            3.0, rel=0.01
        ) and gap.sim.peak_force == pytest.approx(2.0, rel=0.01)
        signals = {s.signal: s for s in second.signals}
        assert signals["wrist/state.z"].lag == pytest.approx(0.02, abs=0.002)
        assert signals["wrist/state.z"].rms_aligned == pytest.approx(0.001, abs=2e-4)
        assert signals["wrist/state.z"].rms > signals["wrist/state.z"].rms_aligned
        assert signals["wrist/state.z"].strikes == 2 and signals["wrist/state.z"].floor < 5e-4
        assert signals["fsr.force"].unit == "N"

    def test_a_note_that_does_not_sound_is_called_missing(self, ros: Any) -> None:
        (report,) = self.play(ros, strikes=1, lag=0.0, silent=True)
        (gap,) = report.keystrokes
        assert gap.real_missing and gap.sim_missing and np.isnan(gap.err)

    @pytest.mark.parametrize("late", [False, True])
    def test_a_strike_that_one_cell_did_not_obey_as_given_is_not_compared(
        self, ros: Any, patient: None, late: bool
    ) -> None:
        word = RefusalPublisher(ros.node("refusing"), "real")

        def disobey(begin: float) -> None:
            if late:
                word.behind("/command/wrist", round(1e9 * (begin + 0.1)), 0.08)
            else:
                word.refuse("/command/wrist", common.time_msg(7), "a test")

        (report,) = self.play(ros, strikes=1, lag=0.0, also=[word._publisher], meanwhile=disobey)
        assert np.isnan(report.keystrokes[0].err) and np.isnan(report.err_mean)
        assert not report.keystrokes[0].real_missing and not report.signals
        (monitor,) = (n for n in ros.nodes if isinstance(n, GapMonitor))
        values = monitor.diagnose()["comparison"].values
        why = "80 ms late" if late else "a test"
        assert values["not_comparable"] == 1 and why in str(values["last_reason"])

    def test_it_waits_for_what_is_late(self, ros: Any, patient: None) -> None:
        clocks = ros.record(TimeReference, "/gap/clocks")
        (report,) = self.play(ros, strikes=1, lag=0.0, late=0.25)
        (gap,) = report.keystrokes
        assert (
            not gap.real_missing
            and not gap.sim_missing
            and gap.real.peak_force == pytest.approx(3.0, rel=0.01)
        )
        assert {s.signal for s in report.signals} == {"wrist/state.z", "fsr.force"}
        assert report.latency > 0.25

        def behind(source: str) -> list[float]:
            return [
                common.seconds(c.header.stamp) - common.seconds(c.time_ref)
                for c in clocks
                if c.source == source
            ]

        # The sights tell how late each device's messages were at the least.
        for source in ("wrist", "fsr"):
            ros.wait_for(
                lambda s=source: min(behind(s), default=np.inf) <= self.sent_after + 1e-6,
                f"the least delay of {source}",
            )
            assert min(behind(source)) > 0.25 - 1e-6
