"""The force sensor's driver: calibration, clock, and against the emulated reader."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import cell_devices as cell
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.cell.numbers.config import load_section
from pianobot_ros.devices.base import DeviceUnavailableError, HealthLevel
from pianobot_ros.devices.fsr import DeviceClock, FsrCalibration, FsrConfig, FsrDriver, FsrReading


def config_for(port: Path, link: dict[str, object] | None = None, **sensor: object) -> FsrConfig:
    return cell.linked(FsrConfig.load(), port, link=link or {}, sensor=sensor)


device = cell.device_fixture("fsr")


def test_the_curve_rises_and_inverts_to_within_a_count() -> None:
    config = FsrConfig.load()
    curve = FsrCalibration(config.calibration.counts, config.calibration.force, config.sensor.bits)
    assert np.all(np.diff(curve.table) >= 0.0)
    for counts, force in zip(config.calibration.counts, config.calibration.force, strict=True):
        assert curve.force(round(counts)) == pytest.approx(force, abs=1e-9)
    for counts in range(20, 4000, 37):
        assert curve.counts(curve.force(counts)) == counts
    assert curve.saturated(curve.top) and not curve.saturated(curve.top - 1)
    assert curve.force(-5) == 0.0 and curve.force(99_999) == curve.force(curve.top)


def test_a_curve_that_falls_is_refused(tmp_path: Path) -> None:
    text = (Path(__file__).resolve().parents[2] / "config" / "fsr.yaml").read_text()
    bad = tmp_path / "fsr.yaml"
    bad.write_text(text.replace("[16, 221, 424", "[16, 424, 221"))
    with pytest.raises(ConfigError, match="counts must rise"):
        load_section(bad, FsrConfig)


@given(st.lists(st.integers(0, 5_000_000), min_size=50, max_size=200), st.integers(0, 2**32 - 1))
def test_late_arrivals_do_not_move_the_stamps(delays: list[int], start_us: int) -> None:
    clock = DeviceClock("fixed")
    delays[0] = 0  # one line in time is enough
    for i, delay in enumerate(delays):
        true = 10**18 + 2_000_000 * i
        assert clock.host_ns((start_us + 2000 * i) % 2**32, true + delay) == true


def test_a_stall_of_this_machine_is_no_restart_and_a_restart_is() -> None:
    for mode in ("fixed", "tracked"):
        clock, start, step = DeviceClock(mode), 10**18, 2_000_000  # type: ignore[arg-type]
        for i in range(3000):  # nothing is read between 3 s and 5 s, then all of it at once
            true = start + step * i
            arrival = start + 5 * 10**9 if 1500 <= i < 2500 else true
            assert clock.host_ns(2000 * i, arrival) == true
        for i in range(100):  # the counter begins anew
            again = start + 8 * 10**9 + step * i
            assert clock.host_ns(7 + 2000 * i, again) == again


def test_a_device_whose_clock_stood_still_is_believed_after_a_second() -> None:
    clock, start, step, stood = DeviceClock("fixed"), 10**18, 2_000_000, 3 * 10**9
    for i in range(2000):
        at = start + step * i + (stood if i >= 1000 else 0)
        stamp = clock.host_ns(2000 * i, at)
        assert stamp == (at - stood if 1000 <= i <= 1500 else at)


def test_tracking_removes_the_drift_and_fixed_keeps_it() -> None:
    skew, step = 200e-6, 2_000_000
    errors = {}
    for mode in ("fixed", "tracked"):
        clock = DeviceClock(mode)  # type: ignore[arg-type]
        for i in range(30_000):  # a minute
            true = 10**18 + step * i
            stamp = clock.host_ns(round(1e-3 * step * i * (1.0 + skew)), true + 300_000)
        errors[mode] = abs(stamp - true - 300_000) * 1e-9
    assert errors["fixed"] == pytest.approx(60.0 * skew, rel=0.05)
    assert errors["tracked"] < 3.0e-3


def test_samples_carry_force_encoder_and_even_stamps(device: cell.Device, tmp_path: Path) -> None:
    seen: list[FsrReading] = []
    with cell.connected(FsrDriver(config_for(tmp_path / "port"), seen.extend)) as driver:
        cell.until(lambda: len(seen) > 1500, "samples")
    late = seen[500:]  # the clock has settled, and these are several presses
    assert max(r.force for r in late) == pytest.approx(5.0, abs=0.02)
    assert max(r.encoder or 0 for r in late) == pytest.approx(0.04 * 0.220 * 56_700, abs=2)
    assert min(r.force for r in late) == 0.0
    assert cell.whole([r.sequence for r in seen], driver)
    assert np.median(np.diff([r.time_ns for r in late])) == pytest.approx(2e6, rel=0.01)


def test_rates_up_to_a_thousand(device: cell.Device, tmp_path: Path) -> None:
    seen: list[FsrReading] = []
    with cell.connected(FsrDriver(config_for(tmp_path / "port"), seen.extend)) as driver:
        assert driver.write(5000.0) == 1000.0
        cell.until(
            lambda: len(seen) > 500 and seen[-1].time_ns - seen[-2].time_ns < 1_200_000, "1 kHz"
        )
        assert device.status()["overruns"] or driver.health().values["lost_lines"] == 0


def test_unplug_garble_silence(device: cell.Device, tmp_path: Path) -> None:
    with cell.connected(
        FsrDriver(config_for(tmp_path / "port", {"silence_timeout": 0.2}))
    ) as driver:
        device.fault("garble 0.2")
        cell.until(lambda: driver.health().values["bad_lines"] > 20, "garbled lines counted")
        cell.until(lambda: driver.health().level is HealthLevel.WARN, "many garbled lines told")
        device.fault("garble 0")
        cell.until(lambda: driver.health().level is HealthLevel.OK, "intact lines again")
        device.fault("silence")
        cell.until(lambda: driver.health().level is HealthLevel.STALE, "silence noticed")
        device.fault("resume")
        cell.until(lambda: driver.health().level is HealthLevel.OK, "resumed")
        device.fault("unplug")
        cell.until(lambda: driver.health().level is HealthLevel.ERROR, "unplugged")
        device.fault("replug")
        cell.until(lambda: driver.health().level is HealthLevel.OK, "streaming again")
        device.process.kill()
        device.process.wait()
        cell.until(lambda: driver.health().level is HealthLevel.ERROR, "killed device noticed")


def test_a_device_that_differs_from_the_configuration_says_so(tmp_path: Path) -> None:
    with cell.Device("fsr", tmp_path, "--link", str(tmp_path / "port"), "--no-encoder"):
        with pytest.raises(DeviceUnavailableError, match="fitted: false"):
            FsrDriver(config_for(tmp_path / "port")).connect()
        with pytest.raises(DeviceUnavailableError, match="12 bits, fsr.yaml says 10"):
            FsrDriver(config_for(tmp_path / "port", bits=10)).connect()


def test_intervals_by_the_boards_own_clock_are_free_of_the_offsets_correction() -> None:
    """While the offset is found, stamps move: a slope over them would be too steep."""
    clock = DeviceClock("fixed")
    stamps, own = [], []
    for i, late in enumerate((30, 30, 5, 0)):  # ms by which a line was read too late
        stamps.append(clock.host_ns(2000 * i, 10**18 + 2_000_000 * i + 1_000_000 * late))
        own.append(clock.own_ns)
    assert [b - a for a, b in pairwise(own)] == [2_000_000] * 3
    assert min(b - a for a, b in pairwise(stamps)) < 0
