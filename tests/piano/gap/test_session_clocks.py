"""The rate of a device's clock is adopted, its offset is seen: twin and device give equal stamps,
whenever the twin adopts.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from piano_twin_cases import record

from pianobot_ros.bags.live_writer import LiveWriter
from pianobot_ros.bags.raw_messages import read_raw
from pianobot_ros.bags.reading.read import read_bag
from pianobot_ros.bags.write import write_bag
from pianobot_ros.cell.recordings.recording import Recording, TimeSeries
from pianobot_ros.emulator.plant.cases.case import Case
from pianobot_ros.emulator.plant.instruments.sensors import SensorClock
from pianobot_ros.piano.gap.adoption.live_laws import LiveLaws, parse_effects
from pianobot_ros.piano.gap.effects import LIBRARY
from pianobot_ros.piano.gap.effects.base import states_of
from pianobot_ros.piano.gap.evidence.session_clocks import SessionClocks, least_lags, set_right

EPOCH = 1_700_000_000_000_000_000  # ns: when the device began
DEVICE = SensorClock(Case({"clock_skew": 8.0}, laws={"clock_skew": 1}))  # a constant rate error


def stamp(seconds: float) -> int:
    """What the device calls the time so many seconds after its start."""
    return EPOCH + round(1e9 * float(DEVICE.read(np.array([seconds]))[0]))


def at(seconds: float) -> int:
    return EPOCH + round(1e9 * seconds)


def look(clocks: SessionClocks, first: float, last: float) -> None:
    """A sight a second; some messages come late."""
    for i, t in enumerate(np.arange(first, last, 1.0)):
        late = 0.004 if i % 3 else 0.0
        clocks.observe("fsr", stamp(t), at(t + least_lags()["fsr"] + late))


def skews() -> dict[str, float]:
    """What a diagnosis finds, as the running twin takes it."""
    rate = (stamp(100.0) - stamp(0.0)) / 1e11
    texts = [f"clock_skew.clock_skew={1.0 - 1.0 / rate!r}", "clock_skew.clock_skew_fsr=1"]
    return LiveLaws(parse_effects(texts)).skews()


@pytest.mark.parametrize("adopted", [10.0, 300.0])
def test_stamps_agree_with_the_device_whenever_its_rate_is_adopted(adopted: float) -> None:
    clocks = SessionClocks()
    look(clocks, adopted - 8.0, adopted)
    assert clocks.stamp("fsr", at(adopted)) == at(adopted)
    clocks.follow(skews())
    look(clocks, adopted, adopted + 5.0)
    for later in (0.0, 1.0, 60.0):
        t = adopted + later
        off = 1e-9 * (clocks.stamp("fsr", at(t)) - stamp(t))
        drift = 1e-9 * (stamp(t) - at(t))
        assert abs(off) < 1e-3 * drift
        assert drift > 1e-3
        assert clocks.stamp("midi", at(t)) == at(t)


def test_what_was_not_seen_is_not_carried_over() -> None:
    clocks = SessionClocks()
    clocks.follow(skews())
    assert clocks.stamp("fsr", at(500.0)) == at(500.0)
    look(clocks, 500.0, 504.0)
    assert clocks.stamp("fsr", at(510.0)) == pytest.approx(stamp(510.0), abs=1e3)
    clocks.observe("fsr", 0, at(511.0))  # a device that does not know the time
    assert clocks.stamp("fsr", at(512.0)) == pytest.approx(stamp(512.0), abs=1e3)


def test_a_device_that_began_anew_is_seen_again() -> None:
    clocks = SessionClocks()
    clocks.follow(skews())
    look(clocks, 300.0, 304.0)
    for t in range(304, 308):
        clocks.observe("fsr", at(t), at(t + least_lags()["fsr"]))
    assert abs(clocks.ahead("fsr", at(308.0))) < 2e-3


def test_without_a_real_cell_the_clocks_run_from_a_given_time() -> None:
    clocks = SessionClocks()
    clocks.follow({"fsr": 1e-3}, since=at(0.0))
    assert clocks.ahead("fsr", at(10.0)) == pytest.approx(0.01, rel=2e-3)
    clocks.follow({})
    assert clocks.ahead("fsr", at(10.0)) == 0.0


def test_states_of_a_session_are_named_where_the_law_is() -> None:
    named = {s for e in LIBRARY.values() for s in states_of(e)}
    assert named == {"joint_friction_rest", "jamming_set"}
    for effect in LIBRARY.values():
        assert states_of(effect) < {p.name for p in effect.parameters}


@pytest.mark.parametrize(
    ("ahead", "left"), [(0.3, 0.0), (-0.3, 0.0), (5e-4, 5e-4), (3600.0, 3600.0)]
)
def test_a_bag_is_set_right_before_its_first_strike_as_a_running_cell_is(
    ahead: float, left: float
) -> None:
    gain, first = 2e-4, 30.0
    true = np.arange(0.0, 40.0, 0.01)
    stamps = true + ahead + gain * (true - first)
    sent = np.arange(0.0, 40.0, 1.0)
    sights = [
        (at(t + least_lags()["fsr"]), ahead + gain * (t - first) - least_lags()["fsr"])
        for t in sent
    ]
    strike = replace(record().strikes[0], start=first, end=first + 1.0)
    signals = {
        "real/fsr.force": TimeSeries(stamps, true, "N"),
        "command/wrist.position": TimeSeries(true, np.zeros((true.size, 3)), "m"),
    }
    recording = Recording(signals, {}, [strike], epoch=1e-9 * EPOCH, sights={"real/fsr": sights})
    found = set_right(recording)
    late = found.signals["real/fsr.force"].time - true
    assert np.interp(first, true, late) == pytest.approx(left, abs=1e-3)
    assert late[-1] - late[0] == pytest.approx(gain * np.ptp(true))
    assert found.signals["command/wrist.position"] is signals["command/wrist.position"]
    assert set_right(found) is found, "once"


def test_bags_tell_what_stamps_show_of_their_clocks(tmp_path: Path) -> None:
    """What is written with stamps as times of the log knows nothing of a clock."""
    recording = record(strikes=2, encoder=False)
    assert read_bag(write_bag(recording, tmp_path / "same")).sights == {}
    writer = LiveWriter(tmp_path / "late")
    for raw in read_raw(tmp_path / "same", []):
        if not writer.knows(raw.topic):
            writer.add_topic(raw.topic, raw.type)
        off = 4_000_000 if raw.topic == "/real/fsr" else 0
        writer.write(raw.topic, raw.log_time + off, raw.data)
    writer.close()
    seen = read_bag(tmp_path / "late").sights
    assert set(seen) == {"real/fsr"}
    assert np.allclose([ahead for _, ahead in seen["real/fsr"]], -0.004, atol=1e-6)
