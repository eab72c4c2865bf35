"""The live stage map's worker: what it practises on is a recording like any other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pianobot_ros.cell.messages.refusals import Refusal
from pianobot_ros.cell.recordings.recording import TimeSeries
from pianobot_ros.piano.gap.diagnosis.live import Collector, StageMap, _practice, stage_map
from pianobot_ros.piano.gap.evidence.blocks import blocks_of
from pianobot_ros.piano.gap.evidence.session_clocks import least_lags


def test_a_worker_practises_on_strikes_that_every_stage_is_judged_by() -> None:
    found = stage_map(_practice())
    assert isinstance(found, StageMap), found
    assert found.strikes == 2
    measured = {name for name, gap, _ in found.stages if np.isfinite(gap)}
    assert measured == {"wrist", "pneumatics", "hand", "contact", "key", "sensing"}


@pytest.mark.parametrize("still", ["fsr", "real/wrist", "real/vacuum", "key_angle", ""])
@pytest.mark.parametrize("count", [1, 2])
def test_strikes_in_which_a_device_says_nothing_new_have_a_map(still: str, count: int) -> None:
    """A finger may miss its key and a sensor may hang: constant signals, or no note, end
    nothing.
    """
    practice = _practice()
    signals = {
        name: TimeSeries(
            x.time,
            0.0 * x.value
            if "fsr" in name or "angle" in name
            else np.repeat(x.value[:1], len(x.time), 0),
            x.unit,
        )
        if still in name
        else x
        for name, x in practice.signals.items()
    }
    found = stage_map(
        replace(practice, signals=signals, notes={"real": []}, strikes=practice.strikes[:count])
    )
    if still == "real/wrist":  # a strike that the arm did not play is not data about the cell
        assert isinstance(found, str) and "the arm did not play" in found
        return
    assert isinstance(found, StageMap), found
    assert all(gap >= 0 for _, gap, _ in found.stages if np.isfinite(gap))


@pytest.mark.parametrize(("ahead", "left"), [(0.3, 0.0), (-0.3, 0.0), (5e-4, 5e-4)])
def test_a_clock_that_is_ahead_is_set_right_at_the_start_of_a_recording(
    ahead: float, left: float
) -> None:
    """A board that was started minutes ago: what it has gained by then is no gap of this phrase."""
    epoch, gain = 1_700_000_000.0, 2e-4
    collector = Collector()
    true = np.arange(0.0, 20.0, 0.002)
    collector.add("command/wrist.position", epoch + true, np.zeros((true.size, 3)))
    collector.add("real/fsr.force", epoch + ahead + (1.0 + gain) * true, true)
    for t in true[::250]:
        stamp, sent = epoch + ahead + (1.0 + gain) * t, epoch + t + least_lags()["fsr"]
        collector.sight("fsr", round(1e9 * stamp), round(1e9 * sent))
    strike = replace(_practice().strikes[0], start=epoch + 5.0, end=epoch + 9.0)
    recording = collector.recording([strike])
    force = recording.signals["real/fsr.force"]
    late = recording.epoch - epoch + force.time - force.value
    assert late[0] == pytest.approx(left, abs=1.1e-3)
    assert late[-1] - late[0] == pytest.approx(gain * np.ptp(force.value), rel=0.01)
    assert np.ptp(force.value) == pytest.approx(4.0 + 2 * 1.2, abs=0.01)


def test_what_the_live_cell_did_not_obey_as_given_is_in_its_recording() -> None:
    """And so no strike of a diagnosis, as from a bag."""
    epoch, collector = 1_700_000_000.0, Collector()
    practice = _practice()
    shift = epoch - practice.strikes[0].start
    for name, signal in practice.signals.items():
        collector.add(name, signal.time + shift, signal.value)
    for strike in practice.strikes:
        collector.strike(replace(strike, start=strike.start + shift, end=strike.end + shift))
    first, second = collector.strikes
    collector.refusal(Refusal(first.start - 60.0, "/command/wrist", 1, "long ago", 0.1))
    collector.refusal(Refusal(second.start + 0.1, "/command/wrist", 2, "late", 0.1))
    recording = collector.recording()
    ((begin, end, topic),) = recording.refusals
    assert topic == "/command/wrist" and end - begin == pytest.approx(0.1, abs=1e-5)
    assert recording.strikes[1].start < begin < end < recording.strikes[1].end
    assert [b.name for b in blocks_of(recording)] == ["strike 0"]
